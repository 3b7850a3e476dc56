"""Reads frames in pieces with VTK, through the index that names them, and compares them with those of one rank."""

import sys

import numpy as np
import pyvista as pv

one, other = (pv.get_reader(f"{folder}/results.pvd") for folder in sys.argv[1:3])
seen = 0
for time in one.time_values:
    for reader in (one, other):
        reader.set_active_time_value(time)
    for whole, found in zip(one.read(), other.read(), strict=True):
        if "GlobalPointIds" not in found.point_data:
            # A body that is whole on every rank.
            assert np.array_equal(whole.points, found.points)
            continue
        seen += 1
        numbers = np.asarray(found.point_data["GlobalPointIds"])
        # The active numbers of the data set, of VTK's own kind, as its filters want them.
        assert found.GetPointData().GetGlobalIds().IsA("vtkIdTypeArray")
        assert found.GetCellData().GetGlobalIds().IsA("vtkIdTypeArray")
        ghosts = np.asarray(found.point_data["vtkGhostType"])
        assert set(ghosts) == {0, 1}
        own = np.flatnonzero(ghosts == 0)
        points = own[np.argsort(numbers[own])]
        assert np.array_equal(numbers[points], np.arange(whole.n_points))
        assert np.array_equal(found.points[points], whole.points)
        cells = np.argsort(found.cell_data["GlobalCellIds"])
        assert np.array_equal(found.cell_data["GlobalCellIds"][cells], np.arange(whole.n_cells))
        corners = whole.cells.size // whole.n_cells
        of = [mesh.cells.reshape(-1, corners)[:, 1:] for mesh in (whole, found)]
        assert np.array_equal(of[0], numbers[of[1]][cells])
        added = {"GlobalPointIds", "GlobalCellIds", "vtkGhostType"}
        for data, reference, order in (
            (found.point_data, whole.point_data, points),
            (found.cell_data, whole.cell_data, cells),
        ):
            assert set(data.keys()) - added == set(reference.keys())
            for name in reference.keys():
                assert np.array_equal(np.asarray(data[name])[order], np.asarray(reference[name])), name
print(f"same: {seen} frames in pieces")
