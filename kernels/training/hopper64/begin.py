"""CUDA text of a fused training step by warpgroups: weights, biases and ones to shared memory."""

from warp_neural.kernels.coopvec.cuda import primitives
from warp_neural.kernels.coopvec.cuda.warpgroups import PUBLISH, stage_weights
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.schedule import HopperSchedule
from warp_neural.kernels.training.text import ones_of


def begin_text(spec: NetworkSpec, schedule: HopperSchedule) -> str:
    """`(params, memory)`. All threads."""
    one = ", ".join([ones_of(spec)] * 4)
    ones = f"reinterpret_cast<uint4*>(shared + {schedule.ones})[threadIdx.x] = make_uint4({one})"
    staged = stage_weights(spec, schedule.layers, schedule.threads, schedule.biases)
    return f"{primitives.prelude(spec)}{staged}if (threadIdx.x < 128u) {ones};\n{PUBLISH}"
