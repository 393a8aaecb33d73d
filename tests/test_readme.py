"""The Python of the README runs as it stands."""

import re
from pathlib import Path

import numpy as np

README = Path(__file__).parent.parent / "README.md"


def test_the_python_of_the_readme_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    for block in blocks:
        exec(block, names)
    printed = capsys.readouterr().out
    assert len(blocks) == 2
    assert printed.startswith("complete")
    D = np.asarray(names["result"].diagnostics["deformation"])[:, 0]
    assert D[0] > 0 > D.min() and D[-1] > 0
    assert np.isfinite(float(printed.splitlines()[-1]))
