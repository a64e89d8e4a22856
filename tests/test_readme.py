"""The README's programs run as they stand, one after the other."""

import importlib.util
import re
from pathlib import Path

import warp as wp

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_programs_run(tmp_path, monkeypatch):
    programs = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    path = tmp_path / "program.py"
    path.write_text("image_of = []\n" + "\nimage_of.append(image.numpy().copy())\n".join(programs))
    monkeypatch.chdir(tmp_path)
    spec = importlib.util.spec_from_file_location("program", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (image,) = module.image_of
    assert image.shape == (64, 64, 3) and image.std() > 0 and (0 < image).all() and (image < 1).all()
    assert module.net.device == wp.get_device()
    assert module.trainer.loss < 0.1 * module.trainer.losses[0] and (tmp_path / "run.safetensors").is_file()
