"""Draws the picture of the README from its first example: python images/first.py, in the folder of the package."""

import pathlib
import re

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np

here = pathlib.Path(__file__).parent
space = {}
exec(re.findall(r"```python\n(.*?)```", (here.parent / "README.md").read_text(), re.S)[0], space)
run, u, x = space["run"], space["u"], space["x"]
plt.rcParams.update({"svg.hashsalt": "first", "font.size": 9})
figure, axes = plt.subplots(figsize=(6.4, 2.4), layout="constrained")
axes.axvspan(0.5, 0.6, color="0.92", label="overlap")
axes.plot(x, 1e6 * u, "C0--", lw=1, label="fine, at the start")
points = run.sample("coarse", np.linspace(0, 0.6, 61))[0][:, 0]
axes.plot(np.linspace(0, 0.6, 61), 1e6 * points, "C1", label="coarse, now")
axes.plot(x, 1e6 * run.displacement("fine")[:, 0], "C0", label="fine, now")
axes.set(xlabel="x [m]", ylabel="displacement [µm]", xlim=(0, 1))
axes.legend(frameon=False, loc="upper center", ncol=4, bbox_to_anchor=(0.5, 1.25))
figure.savefig(here / "first.svg", metadata={"Date": None})
