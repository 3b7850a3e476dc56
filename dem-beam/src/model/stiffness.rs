//! The stiffness matrix in compressed rows, rotations included.

use crate::particles::BondedParticles;
use nalgebra::Matrix6;
use sprs::CsMat;

/// Returns the blocks `K_ij` of every particle i, in ascending columns, the diagonal block included.
fn block_rows(body: &BondedParticles) -> Vec<Vec<(u32, Matrix6<f64>)>> {
    let mut rows: Vec<Vec<(u32, Matrix6<f64>)>> = (0..body.len())
        .map(|i| vec![(i as u32, Matrix6::zeros())])
        .collect();
    for (bond, &[i, j]) in body.bonds().zip(body.pairs()) {
        let k = bond.stiffness(body.rigidity());
        for (a, b, offset, other_offset) in [(i, j, 0, 6), (j, i, 6, 0)] {
            let row = &mut rows[a as usize];
            // The diagonal block is first until rows are sorted.
            row[0].1 += k.fixed_view::<6, 6>(offset, offset);
            let block = k.fixed_view::<6, 6>(offset, other_offset);
            match row.iter_mut().skip(1).find(|(c, _)| *c == b) {
                Some((_, sum)) => *sum += block,
                None => row.push((b, block.into_owned())),
            }
        }
    }
    for row in &mut rows {
        row.sort_unstable_by_key(|(c, _)| *c);
    }
    rows
}

/// Assembles `K` with `f = -K q`, for unknowns `u_0 u_1 ... th_0 th_1 ...` \[N/m, N, N m\].
pub(crate) fn assemble(body: &BondedParticles) -> CsMat<f64> {
    let n = body.len();
    let rows = block_rows(body);
    let entries = 36 * rows.iter().map(Vec::len).sum::<usize>();
    let mut start = Vec::with_capacity(6 * n + 1);
    let (mut columns, mut values) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
    start.push(0);
    // Rows and columns go through all displacements, then through all rotations.
    for part in 0..2 {
        for row in &rows {
            for a in 0..3 {
                for side in 0..2 {
                    for (j, block) in row {
                        for c in 0..3 {
                            columns.push(3 * n * side + 3 * *j as usize + c);
                            values.push(block[(3 * part + a, 3 * side + c)]);
                        }
                    }
                }
                start.push(columns.len());
            }
        }
    }
    CsMat::new((6 * n, 6 * n), start, columns, values)
}
