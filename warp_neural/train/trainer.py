"""`Trainer`: samples, forward, loss, gradients and optimizer of a network, on the device alone."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from tqdm import tqdm

from warp_neural.errors import InputError
from warp_neural.io.files import check_target
from warp_neural.kernels.errors import LARGEST, require_whole
from warp_neural.kernels.nn.losses import Loss, l2
from warp_neural.kernels.nn.spec import INT8
from warp_neural.nn.mlp import MLP
from warp_neural.train.arguments import batch_sizes, check_arguments, check_data, digest
from warp_neural.train.checkpoint import load_checkpoint, save_checkpoint
from warp_neural.train.cpu_steps import FusedCpu
from warp_neural.train.optim import SGD, Adam
from warp_neural.train.progress import HISTORY, make_progress, make_update
from warp_neural.train.sample import explained
from warp_neural.train.steps import FusedCuda, Taped, schedule_of

SAVE_SECONDS = 30  # between checkpoints
CHECK = 32  # steps between looks at the loss; as many are one launch of a CUDA graph


def fused_steps(net: MLP) -> type[FusedCuda | FusedCpu] | None:
    """What takes a step of `net` in one kernel, if anything does."""
    if net.implementation != "cooperative":
        return None
    if net.device.is_cuda:
        return FusedCuda if schedule_of(net) else None
    return None if net.spec.format is INT8 else FusedCpu


class Trainer:
    """Trains `net` on samples that `sample` makes, without the host: see `run`.

    sample: a `@wp.func` `(index: int, random: wn.random.Stream, data: D) -> (x: net.vec_in, target)`, the target a
    vector of n_out floats, or one without the last argument; it draws by `wn.random.uniform(random, 0)`. `data` is what
    it reads: an array, or a struct of arrays. loss: see `wn.losses`; its mean over the batch counts.
    batch: samples of a step, one number, or those of the steps to come, the last one staying, for a batch that grows.
    batches: how many batches' gradients are added up for one step. average: the decay, such as 0.99, of an exponential
    moving average of the parameters, in `averaged`. loss_scale: what gradients are multiplied by to fit float16; by
    default 128 to begin with, halved after a step whose gradient is not finite, which is skipped.

    An int8 network is calibrated with the samples of the first step, and at each step from 256 of its samples, where a
    larger range stays and fades by 1 % a step: the steps of inputs follow the network as it learns.

    Parameters of an encoding that is `sparse`, a hash grid, rest in steps that do not reach them; averages go on.

    One kernel takes a batch (`fused`), if the implementation is "cooperative", on CUDA of float16 and bfloat16 networks
    of up to 64 neurons (fewer where blocks have little shared memory), on the CPU of all but int8. On Hopper so are
    networks of one to three layers of 128, which from two on take another kernel and up to 768 bytes of memory a
    sample. Other networks train through the adjoint of the loss. Two runs with the same seed end alike bit for bit on
    one device, except, on CUDA, those that add to memory atomically: networks that are not `fused`, and encodings with
    parameters.
    """

    def __init__(
        self,
        net: MLP,
        *,
        sample: wp.Function,
        data: Any = 0,
        loss: Loss = l2,
        optimizer: Adam | SGD | None = None,
        batch: int | Sequence[int] = 1 << 16,
        batches: int = 1,
        average: float | None = None,
        loss_scale: float | None = None,
        fused: bool | None = None,
        seed: int = 0,
    ):
        numbers = {"batches": batches, "average": average, "loss_scale": loss_scale, "seed": seed}
        check_arguments(net, sample, loss, optimizer, numbers)
        check_data(sample, data, net.device)
        sizes = batch_sizes(batch, batches)
        in_one = fused_steps(net)
        if fused and in_one is None:
            raise InputError("fused=True: not for this network on this device (see Trainer); leave it out")
        kind = Taped if fused is False or in_one is None else in_one
        self.net, self.device, self.fused = net, net.device, kind is not Taped
        self.optimizer = optimizer or Adam()
        self.optimizer.bind(net.master)
        self.sizes, self.batches, self.seed, self.index = sizes, batches, seed, 0
        self.loss_function, self.loss_scale = loss, loss_scale
        scale = loss_scale or (128.0 if kind is FusedCuda else 1.0)
        self.progress = make_progress(self.optimizer, sizes, scale, seed)
        dynamic = kind is FusedCuda and loss_scale is None
        self.options = make_update(self.optimizer, net.master.size, batches, average, dynamic)
        arguments = (net, self.optimizer, self.progress, self.options, sample, data, loss, self.sizes)
        with explained(sample, net):
            self.launches = kind(*arguments)
        self._graphs: dict[int, Any] = {}

    def __repr__(self) -> str:
        batch = " to ".join(map(str, dict.fromkeys((self.batch_of(0), int(self.sizes[-1])))))
        parts = [self.net, self.loss_function.name, self.optimizer, f"batch={batch}", f"step {self.index}"]
        return f"Trainer({', '.join(map(str, parts))}, {'fused' if self.fused else 'taped'})"

    def gradient(self) -> np.ndarray:
        """The gradient of the loss of the next step, which is not taken; float32 [net.master.size]."""
        self._settle()
        self._gradient()
        total = self.launches.gathered()
        self._settle()
        return total / (self.progress.scale.numpy()[self.index % 2] * self.batch_of(self.index) * self.batches)

    def _settle(self) -> None:
        """Between two steps, whatever came before: the device's count of steps holds, and nothing of a step that was
        not finished, or of other gradients, enters the next."""
        self.index = int(self.progress.counters.numpy()[0])
        self.net.gradient.zero_()
        for array in (self.progress.flags, self.progress.losses):
            at = self.index % len(array)
            array[at : at + 1].zero_()

    def _gradient(self) -> None:
        for micro in range(self.batches):
            self.launches.gradient(micro)

    def _step(self) -> None:
        self._gradient()
        self.launches.update()

    def _launch(self, steps: int) -> None:
        if not self.device.is_cuda or steps < CHECK:  # a graph for every count would cost more than it saves
            for _ in range(steps):
                self._step()
            return
        if steps not in self._graphs:
            with wp.ScopedCapture(self.device) as capture:
                for _ in range(steps):
                    self._step()
            self._graphs[steps] = capture.graph
        wp.capture_launch(self._graphs[steps])

    def run(
        self, steps: int, *, target: float = 0.0, checkpoint: Path | str | None = None, quiet: bool = False
    ) -> float:
        """Take `steps` steps, fewer if `loss` falls below `target` before; returns the loss.

        `loss` is looked at every 32 steps. checkpoint: a file to `save` to every 30 seconds and at the end. A progress
        bar shows the loss and samples a second, unless `quiet` or without a terminal. Raises `InputError` where no
        gradient was finite for 32 steps; they left the parameters as they were. After an error or Ctrl-C `index` is
        what the device has done, and the run can go on.
        """
        require_whole("steps", steps, 0, LARGEST - self.index)
        if checkpoint:
            check_target(checkpoint)
        self._settle()
        try:
            return self._run(steps, target, checkpoint, quiet)
        except BaseException:
            self._settle()
            self.net.pack()
            raise

    def _run(self, steps: int, target: float, checkpoint: Path | str | None, quiet: bool) -> float:
        end, begin, samples = self.index + steps, time.perf_counter(), 0
        saved = begin
        with tqdm(total=steps, disable=True if quiet else None, file=sys.stderr, unit="step") as bar:
            while self.index < end:
                count = min(CHECK - self.index % CHECK, end - self.index)
                self._launch(count)
                samples += self.batches * sum(self.batch_of(i) for i in range(self.index, self.index + count))
                self.index += count
                self._check()
                loss, now = self.loss, time.perf_counter()
                if checkpoint and now - saved > SAVE_SECONDS:
                    self.save(checkpoint)
                    saved = now
                rate = samples / (now - begin)
                bar.set_postfix_str(f"loss {loss:.3g}, {rate:.3g} samples/s", refresh=False)
                bar.update(count)
                if loss < target:
                    break
        if checkpoint:
            self.save(checkpoint)
        return self.loss

    def batch_of(self, step: int) -> int:
        """Samples of one batch of step `step`."""
        return int(self.sizes[min(step, len(self.sizes) - 1)])

    @property
    def losses(self) -> np.ndarray:
        """The loss of the last steps, float32 [min(steps so far, 16,384)]; of a skipped step not finite."""
        losses = np.roll(self.progress.losses.numpy(), -(self.index % HISTORY))
        return _read_only(losses[len(losses) - min(self.index, HISTORY) :])

    @property
    def loss(self) -> float:
        """The mean loss of the last 32 steps; NaN before the first."""
        count = min(self.index, CHECK)
        first = (self.index - count) % HISTORY
        whole = first + count <= HISTORY
        last = self.progress.losses[first : first + count].numpy() if whole else self.losses[-count:]
        return float(last.mean()) if count else float("nan")

    @property
    def skipped(self) -> int:
        """Steps skipped so far, because their gradient was not finite."""
        return int(self.progress.skipped.numpy()[self.index % 2])

    @property
    def averaged(self) -> np.ndarray:
        """The moving average of `net.master`, float32; to use it: `net.master.assign(trainer.averaged); net.pack()`."""
        if not self.options.average.size:
            raise InputError("no average was kept; make the Trainer with average=0.99, for example")
        return _read_only(self.options.average.numpy().copy())

    def _check(self) -> None:
        if self.progress.good.numpy()[self.index % 2] <= -CHECK:
            raise InputError(
                f"training stopped at step {self.index}: no gradient was finite for {CHECK} steps. Look for NaN or "
                "infinity in the data, lower the learning rate, or train in float32"
            )

    def save(self, path: Path | str) -> None:
        """Write all that the run needs to go on, whole or not at all, as safetensors."""
        save_checkpoint(path, self.net, self.index, self._configuration(), self._state())

    def load(self, path: Path | str) -> None:
        """Go on where `save` was called: the same steps follow bit for bit (see the class). The trainer is to be made
        with the same arguments. Raises `InputError` for a damaged file or one of another network; nothing changes then.
        """
        self.index = load_checkpoint(path, self.net, self._configuration(), self._state())
        self.progress.counters.fill_(self.index)

    def _configuration(self) -> dict:
        """What another run could have otherwise; of long arrays a digest."""
        return {
            "seed": int(self.seed),
            "optimizer": type(self.optimizer).__name__,
            "settings": list(map(float, self.optimizer.settings)),
            "rate": digest(self.optimizer.lr),
            "batch": digest(self.sizes),
            "batches": int(self.batches),
            "loss": repr(self.loss_function),
            "decay": self.options.decay,
            "loss_scale": self.loss_scale,
            "fused": self.fused,
        }

    def _state(self) -> dict[str, wp.array]:
        """What changes from step to step beside the network."""
        arrays = {name: getattr(self.progress, name) for name in ("skipped", "good", "flags", "scale", "losses")}
        return arrays | {name: getattr(self.options, name) for name in ("first", "second", "average")}


def _read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array
