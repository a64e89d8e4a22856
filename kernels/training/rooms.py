"""The rooms of fused training on CUDA, and which of them takes a network."""

from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.room import HOPPER64
from warp_neural.kernels.training.hopper128.room import HOPPER128
from warp_neural.kernels.training.mma.room import MMA
from warp_neural.kernels.training.schedule import Room, Schedule

ROOMS = (HOPPER64, HOPPER128, MMA)  # the first that takes a network is the fastest


def choose_schedule(spec: NetworkSpec, arch: int, shared_bytes: int) -> Schedule | None:
    """For a device of architecture `arch`, 90 for sm_90, whose blocks have so much shared memory; None: not fused."""
    if arch < spec.format.min_arch:
        return None
    schedules = (room.make_schedule(spec, arch, shared_bytes) for room in ROOMS)
    return next((schedule for schedule in schedules if schedule), None)


def room_of(schedule: Schedule) -> Room:
    return next(room for room in ROOMS if type(schedule) is room.schedule)
