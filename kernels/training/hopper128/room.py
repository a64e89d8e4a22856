"""Training by `wgmma` for 128 neurons a layer, as `kernels.training.rooms` lists it."""

import warp as wp

from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.backward import input_gradient_text
from warp_neural.kernels.training.hopper64.begin import begin_text
from warp_neural.kernels.training.hopper128.backward import (
    begin_first_layer_text,
    finish_text,
    first_layer_text,
    upper_layers_text,
)
from warp_neural.kernels.training.hopper128.forward import enter, forward_text
from warp_neural.kernels.training.hopper128.lower import fetch_text, lower_layers_text
from warp_neural.kernels.training.hopper128.schedule import Hopper128LowerSchedule, Hopper128Schedule, make_schedule
from warp_neural.kernels.training.schedule import LowerTexts, Room, Texts


def make_texts(spec: NetworkSpec, schedule: Hopper128Schedule, x_type: type, input_gradient: bool) -> Texts:
    return Texts(
        begin_text(spec, schedule),
        forward_text(spec, schedule, x_type is wp.float16),
        upper_layers_text(spec, schedule),
        begin_first_layer_text(spec, schedule),
        first_layer_text(spec, schedule, input_gradient),
        input_gradient_text(spec, schedule, enter(spec, schedule), x_type),
        finish_text(schedule),
    )


def make_lower_texts(
    spec: NetworkSpec, lower: Hopper128LowerSchedule, x_type: type, input_gradient: bool
) -> LowerTexts:
    return LowerTexts(
        begin_text(spec, lower),
        fetch_text(spec, lower),
        lower_layers_text(spec, lower, input_gradient),
        input_gradient_text(spec, lower, enter(spec, lower), x_type),
        finish_text(lower),
    )


HOPPER128 = Room(Hopper128Schedule, make_schedule, make_texts, make_lower_texts)
