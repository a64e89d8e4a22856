"""What samples there are: `python -m samples`."""

import ast
from pathlib import Path

from warp_neural.cli.ending import ending
from warp_neural.cli.parsing import program
from warp_neural.cli.printing import printable

FOLDER = Path(__file__).parent


def listed(name: str) -> list[str]:
    """A line for each section and each of its steps: how it is called, and what its docstring begins with."""
    lines = []
    for section in sorted(path.parent for path in FOLDER.glob("*/__main__.py")):
        for path in (section / "__main__.py", *sorted(section.glob("step_*.py"))):
            module = section.name if path.stem == "__main__" else f"{section.name}.{path.stem}"
            about = ast.get_docstring(ast.parse(path.read_text("utf-8"))).splitlines()[0].split(": ", 1)[-1]
            lines.append(f"{name}.{module}\n    {about}")
    return lines


if __name__ == "__main__":
    printable()
    with ending():
        print("\n".join([*listed(program()), "Each tells its options with --help."]))
