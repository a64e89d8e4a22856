"""The README's program runs as it stands."""

import importlib.util
import re
from pathlib import Path

import warp as wp

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_smallest_program_runs(tmp_path):
    (program,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    path = tmp_path / "program.py"
    path.write_text(program)
    spec = importlib.util.spec_from_file_location("program", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    image = module.image.numpy()
    assert image.shape == (64, 64, 3) and image.std() > 0 and (0 < image).all() and (image < 1).all()
    assert module.net.device == wp.get_device()
