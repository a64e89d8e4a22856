"""Training by `mma.sync`, as `kernels.training.rooms` lists it."""

from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.mma.backward import first_layer_text, input_gradient_text, upper_layers_text
from warp_neural.kernels.training.mma.finish import finish_text
from warp_neural.kernels.training.mma.forward import begin_text, forward_text
from warp_neural.kernels.training.mma.schedule import MmaSchedule, make_schedule
from warp_neural.kernels.training.schedule import Room, Texts


def make_texts(spec: NetworkSpec, schedule: MmaSchedule, x_type: type, input_gradient: bool) -> Texts:
    return Texts(
        begin_text(spec, schedule),
        forward_text(spec, schedule),
        upper_layers_text(spec, schedule),
        "return sums;",
        first_layer_text(spec, schedule, input_gradient),
        input_gradient_text(spec, schedule, x_type),
        finish_text(schedule),
    )


MMA = Room(MmaSchedule, make_schedule, make_texts)
