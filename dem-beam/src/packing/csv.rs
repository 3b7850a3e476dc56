//! Positions and radii as text: one line `x,y,z,r` per sphere, m, after an optional header.
//!
//! Numbers are written with as many digits as they need to come back bit for bit.

use super::bonding::bond_and_trim;
use super::cells::Sphere;
use super::container::Container;
use super::protocol::Packing;
use crate::error::{DemError, Result};
use crate::particles::{COINCIDENT, check_spheres};
use nalgebra::Vector3;
use std::io::{BufRead, Write};

/// Writes the spheres of a packing.
///
/// # Errors
/// [`DemError::Io`].
pub fn write_csv(out: &mut impl Write, positions: &[Vector3<f64>], radii: &[f64]) -> Result<()> {
    let io = |e: std::io::Error| DemError::Io {
        path: "csv output".into(),
        reason: e.to_string(),
    };
    writeln!(out, "x,y,z,r").map_err(io)?;
    for (p, r) in positions.iter().zip(radii) {
        writeln!(out, "{:?},{:?},{:?},{:?}", p.x, p.y, p.z, r).map_err(io)?;
    }
    Ok(())
}

/// Reads spheres; commas, semicolons, tabs or spaces separate the four numbers.
///
/// # Errors
/// [`DemError::Parse`] with the line, [`DemError::Io`], and those of bad spheres:
/// [`DemError::NotFinite`], [`DemError::BadRadius`], [`DemError::RadiusRatio`].
pub fn read_csv(input: &mut impl BufRead) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let (mut positions, mut radii) = (Vec::new(), Vec::new());
    for (k, line) in input.lines().enumerate() {
        let line = line.map_err(|e| DemError::Io {
            path: "csv input".into(),
            reason: e.to_string(),
        })?;
        let text = line.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let fields: Vec<&str> = text
            .split([',', ';', '\t', ' '])
            .filter(|f| !f.is_empty())
            .collect();
        let numbers: std::result::Result<Vec<f64>, _> = fields.iter().map(|f| f.parse()).collect();
        match numbers {
            Ok(v) if v.len() == 4 => {
                positions.push(Vector3::new(v[0], v[1], v[2]));
                radii.push(v[3]);
            }
            Ok(v) => {
                let reason = format!("{} numbers found, 4 needed: x,y,z,r", v.len());
                return Err(DemError::Parse { line: k + 1, reason });
            }
            // Words are allowed once, as a header.
            Err(_) if positions.is_empty() && k == 0 => {}
            Err(e) => {
                return Err(DemError::Parse {
                    line: k + 1,
                    reason: format!("{text:?}: {e}"),
                });
            }
        }
    }
    check_spheres(&positions, &radii)?;
    Ok((positions, radii))
}

impl Packing {
    /// Bonds given spheres as the protocol does: the pairs nearest to touching up to the wanted
    /// coordination number, largest connected component.
    ///
    /// # Errors
    /// Those of bad spheres, [`DemError::CoincidentParticles`], [`DemError::Overlapping`] if a
    /// sphere holds the centre of another, [`DemError::OutsideContainer`] if
    /// a sphere passes a wall by more than half its radius, [`DemError::TooFewPairs`].
    pub fn from_spheres(
        container: &Container,
        positions: &[Vector3<f64>],
        radii: &[f64],
        coordination: f64,
    ) -> Result<Self> {
        check_spheres(positions, radii)?;
        crate::error::positive("coordination number", coordination)?;
        let mut container = container.clone();
        let largest = radii.iter().fold(0.0_f64, |m, r| m.max(*r));
        container.prepare(1.5 * largest);
        for (particle, (x, r)) in positions.iter().zip(radii).enumerate() {
            let (excess, limit) = (r - container.gap(x, *r), 0.5 * r);
            if excess > limit || !(excess <= 0.0 || container.contains(x)) {
                return Err(DemError::OutsideContainer {
                    particle,
                    excess,
                    limit,
                });
            }
        }
        let spheres: Vec<Sphere> = positions
            .iter()
            .zip(radii)
            .map(|(x, r)| [x.x, x.y, x.z, *r])
            .collect();
        let period = container.period();
        refuse_overlapping(&spheres, period)?;
        let bonding = bond_and_trim(&spheres, coordination, period)?;
        let overlap = mean_overlap(&spheres, period);
        Ok(Self::assemble(&container, &spheres, bonding, overlap, 0))
    }
}

fn refuse_overlapping(spheres: &[Sphere], period: Option<[f64; 3]>) -> Result<()> {
    for (gap, [i, j]) in super::bonding::near_pairs(spheres, 0.0, period) {
        let (first, second) = (i as usize, j as usize);
        let touch = spheres[first][3] + spheres[second][3];
        if gap + 1.0 <= COINCIDENT {
            return Err(DemError::CoincidentParticles {
                first,
                second,
                distance: (gap + 1.0) * touch,
                limit: COINCIDENT * touch,
            });
        }
        let (distance, limit) = ((gap + 1.0) * touch, spheres[first][3].max(spheres[second][3]));
        if distance < limit {
            return Err(DemError::Overlapping {
                first,
                second,
                distance,
                limit,
            });
        }
    }
    Ok(())
}

/// Mean overlap of touching pairs over the mean diameter.
fn mean_overlap(spheres: &[Sphere], period: Option<[f64; 3]>) -> f64 {
    let touching = super::bonding::near_pairs(spheres, 0.0, period);
    let total: f64 = touching
        .iter()
        .map(|(gap, [i, j])| -gap * (spheres[*i as usize][3] + spheres[*j as usize][3]))
        .sum();
    let mean = spheres.iter().map(|s| s[3]).sum::<f64>() / spheres.len() as f64;
    total / touching.len().max(1) as f64 / (2.0 * mean)
}
