"""Finite elements of scikit-fem as the coarse model of our particles: a pulse leaves a packing of spheres for a mesh.

`pip install scikit-fem`. scikit-fem assembles; every element matrix has the weight of its element, so that both
models together have the energy of one body.
"""

import numpy as np
import skfem
from skfem.helpers import ddot, dot, sym_grad, trace

import arlequin as aq

YOUNG, POISSON, DENSITY = 72.5e9, 0.17, 2200.0
SILICA = aq.Elastic(YOUNG, POISSON, DENSITY)
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


class SkfemModel(aq.LinearModel):
    """Linear elasticity of hexahedra; `mesh` is one of scikit-fem."""

    def __init__(self, name, mesh):
        self.name, self.kind = name, "scikit-fem"
        self.basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()))
        # Corners of a hexahedron in the order of ours, whose Jacobian is positive.
        local = [np.flatnonzero((mesh.elem.refdom.p.T == c).all(1))[0] for c in CORNERS]
        if mesh.mapping().detDF(np.full((3, 1), 0.5)).max() < 0:
            local = local[4:] + local[:4]
        self.mesh = aq.Mesh("hex", mesh.p.T, mesh.t[local].T)
        assert (self.basis.nodal_dofs.T.ravel() == np.arange(self.basis.N)).all()

    def of_elements(self, weight):
        return np.repeat(weight[:, None], self.basis.X.shape[1], axis=1)

    def stiffness(self, weight):
        lame, mu = YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON), YOUNG / (2 * (1 + POISSON))

        @skfem.BilinearForm
        def energy(u, v, w):
            e, d = sym_grad(u), sym_grad(v)
            return w["share"] * (lame * trace(e) * trace(d) + 2 * mu * ddot(e, d))

        return energy.assemble(self.basis, share=self.of_elements(weight))

    def inertia(self, weight):
        mass = skfem.BilinearForm(lambda u, v, w: DENSITY * w["share"] * dot(u, v))
        return mass.assemble(self.basis, share=self.of_elements(weight)).sum(axis=1)


def couple(model=SkfemModel, coarse_to=12e-3, fine_to=18e-3, width=1.5e-3):
    """A bar along x: scikit-fem up to 12 mm, particles from 8 mm on, which move towards it."""
    grid = [np.linspace(0, coarse_to, 25), *[np.linspace(0, width, 4)] * 2]
    left = model("left", skfem.MeshHex.init_tensor(*grid))
    start = coarse_to - 4e-3
    packing = aq.Packing.block((start, 0, 0), (fine_to, width, width), 1500, seed=1, quench=True)
    right = aq.DemModel("right", packing, DENSITY)
    share = aq.Weights.same(aq.Ramp(aq.Slab(fine=(coarse_to, 0, 0), coarse=(start, 0, 0)), "cubic", 1e-3))
    # A pulse that runs towards lower x: u(x + c t), of which half the energy is kinetic.
    s = np.clip((right.nodes[:, 0] - coarse_to) / (fine_to - coarse_to), 0, 1)
    q, v = np.zeros((2, 2, len(s), 3))
    q[0, :, 0] = 1e-7 * np.sin(np.pi * s) ** 2
    v[0, :, 0] = 1e-7 * SILICA.bar_speed * np.pi / (fine_to - coarse_to) * np.sin(2 * np.pi * s)
    fine = aq.Subdomain.fine(right, aq.Weights.complement_of(share)).with_initial(q, v)
    across = aq.Mesh.block("hex", (start, 0, 0), (coarse_to, width, width), (8, 3, 3))
    tie = aq.Interface("overlap", "left", "right", across, sampling="particles")
    return aq.Coupled([aq.Subdomain.coarse(left, share), fine], [tie], chosen=0.8)


def main():
    run = couple()
    total = run.energy
    run.run_until(9e-3 / SILICA.bar_speed)
    share = run.inertia("left") @ run.velocity("left").ravel() ** 2 / total
    print(f"{run.steps} steps: drift {run.drift:.1e}, {share:.1%} of the pulse has gone into the mesh of scikit-fem")
    return run.drift, share


if __name__ == "__main__":
    main()
