"""Training by `wgmma` for 64 neurons a layer, as `kernels.training.rooms` lists it."""

import warp as wp

from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.backward import (
    begin_first_layer_text,
    first_layer_text,
    input_gradient_text,
    upper_layers_text,
)
from warp_neural.kernels.training.hopper64.begin import begin_text
from warp_neural.kernels.training.hopper64.finish import finish_text
from warp_neural.kernels.training.hopper64.forward import enter, forward_text
from warp_neural.kernels.training.hopper64.schedule import Hopper64Schedule, make_schedule
from warp_neural.kernels.training.schedule import Room, Texts


def make_texts(spec: NetworkSpec, schedule: Hopper64Schedule, x_type: type, input_gradient: bool) -> Texts:
    return Texts(
        begin_text(spec, schedule),
        forward_text(spec, schedule, x_type is wp.float16),
        upper_layers_text(spec, schedule),
        begin_first_layer_text(spec, schedule),
        first_layer_text(spec, schedule, input_gradient),
        input_gradient_text(spec, schedule, enter(spec, schedule), x_type),
        finish_text(schedule),
    )


HOPPER64 = Room(Hopper64Schedule, make_schedule, make_texts)
