//! Positions and radii as text: one line `x,y,z,r` per sphere \[m\], after an optional header.
//!
//! Numbers are written with as many digits as they need to be read back bit for bit.

use super::assemble::{Filled, Packing};
use super::bonding::Loose;
use super::bonding::bond_and_trim;
use super::cells::{self, Sphere, centre, mean_radius};
use super::container::Container;
use super::narrow;
use crate::error::{Error, Result};
use crate::particles::{COINCIDENT, check_spheres};
use nalgebra::Vector3;
use std::io::{BufRead, Write};

/// Writes spheres as text.
///
/// # Errors
/// [`Error::Io`].
pub fn write_csv(out: &mut impl Write, positions: &[Vector3<f64>], radii: &[f64]) -> Result<()> {
    let io = |e: std::io::Error| Error::Io {
        path: "csv output".into(),
        reason: e.to_string(),
    };
    writeln!(out, "x,y,z,r").map_err(io)?;
    for (p, r) in positions.iter().zip(radii) {
        writeln!(out, "{:?},{:?},{:?},{:?}", p.x, p.y, p.z, r).map_err(io)?;
    }
    Ok(())
}

/// Reads spheres from text; commas, semicolons, tabs or spaces separate the four numbers.
///
/// # Errors
/// [`Error::Parse`] with the line, [`Error::Io`]; for bad spheres [`Error::NotFinite`], [`Error::BadRadius`],
/// [`Error::RadiusRatio`].
pub fn read_csv(input: &mut impl BufRead) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let mut text = String::new();
    input.read_to_string(&mut text).map_err(|e| Error::Io {
        path: "csv input".into(),
        reason: e.to_string(),
    })?;
    // The reader takes one separator. Two in a row leave an empty field, which is skipped below.
    let text = text.replace([';', '\t', ' '], ",");
    let mut lines = csv::ReaderBuilder::new();
    lines.has_headers(false).flexible(true).quoting(false);
    let (mut positions, mut radii) = (Vec::new(), Vec::new());
    for line in lines.from_reader(text.as_bytes()).records() {
        let line = line.map_err(|e| Error::Parse {
            line: e.position().map_or(0, |p| p.line() as usize),
            reason: e.to_string(),
        })?;
        let fields: Vec<&str> = line.iter().filter(|f| !f.is_empty()).collect();
        if fields.first().is_none_or(|f| f.starts_with('#')) {
            continue;
        }
        let number = || line_number(&text, line.position().map_or(0, |p| p.byte() as usize));
        let numbers: std::result::Result<Vec<f64>, _> = fields.iter().map(|f| f.parse()).collect();
        let reason = match numbers.as_deref() {
            Ok(&[x, y, z, r]) => {
                positions.push(Vector3::new(x, y, z));
                radii.push(r);
                continue;
            }
            Ok(v) => format!("{} numbers found, 4 needed: x,y,z,r", v.len()),
            // The first line may be a header.
            Err(_) if number() == 1 => continue,
            Err(e) => format!("{:?}: {e}", fields.join(",")),
        };
        return Err(Error::Parse {
            line: number(),
            reason,
        });
    }
    check_spheres(&positions, &radii)?;
    Ok((positions, radii))
}

/// Returns the number of the line, from 1, of the record after byte `start`. The reader counts a record from
/// the blank lines before it.
fn line_number(text: &str, start: usize) -> usize {
    let is_blank = |b: &u8| matches!(b, b'\r' | b'\n');
    let bytes = text.as_bytes();
    let blank = bytes.iter().skip(start).take_while(|b| is_blank(b)).count();
    1 + bytes.iter().take(start + blank).filter(|b| **b == b'\n').count()
}

impl Packing {
    /// Bonds given spheres as the packing protocol does: in every body the pairs nearest to touching become
    /// bonds, up to the wanted coordination number. Loose spheres are left out within
    /// [`super::LOOSE_LIMIT`].
    ///
    /// # Errors
    /// Errors of bad spheres, [`Error::CoincidentParticles`], [`Error::Overlapping`] if a sphere contains the
    /// centre of another, [`Error::OutsideContainer`] if a sphere passes a wall by more than half its radius,
    /// [`Error::TooFewPairs`], [`Error::LooseSpheres`]; for one of several bodies within [`Error::InBody`];
    /// [`Error::EmptyBody`], [`Error::CrossingBodies`].
    pub fn from_spheres(
        container: &Container,
        positions: &[Vector3<f64>],
        radii: &[f64],
        coordination: f64,
    ) -> Result<Self> {
        Self::from_spheres_with(container, positions, radii, coordination, Loose::default())
    }

    /// Works like [`Self::from_spheres`], with a chosen treatment of loose spheres.
    ///
    /// # Errors
    /// Errors of [`Self::from_spheres`].
    pub fn from_spheres_with(
        container: &Container,
        positions: &[Vector3<f64>],
        radii: &[f64],
        coordination: f64,
        loose: Loose,
    ) -> Result<Self> {
        check_spheres(positions, radii)?;
        crate::error::positive("coordination number", coordination)?;
        let mut container = container.clone();
        let largest = radii.iter().fold(0.0_f64, |m, r| m.max(*r));
        container.prepare(1.5 * largest);
        for (particle, (x, r)) in positions.iter().zip(radii).enumerate() {
            // Packings press into their walls a little, but not by half a radius.
            let (excess, limit) = (r - container.gap(x, *r), 0.5 * r);
            if excess > limit || !(excess <= 0.0 || container.contains(x)) {
                return Err(Error::OutsideContainer {
                    particle,
                    excess,
                    limit,
                });
            }
        }
        let spheres = cells::spheres(positions, radii);
        let period = container.period();
        refuse_overlapping(&spheres, period)?;
        let mut bodies = container.bodies();
        bodies.iter_mut().for_each(|b| b.prepare(1.5 * largest));
        let home = homes(&bodies, &spheres, largest);
        let mut filled = Vec::with_capacity(bodies.len());
        for k in 0..bodies.len() {
            let numbers: Vec<u32> = (0..spheres.len() as u32)
                .filter(|&i| home[i as usize] == k)
                .collect();
            let members: Vec<Sphere> = numbers.iter().map(|&i| spheres[i as usize]).collect();
            let bonding = match members.is_empty() {
                true => Err(Error::EmptyBody),
                false => bond_and_trim(&members, coordination, period, loose)
                    .map_err(|e| narrow::name_width(e, &bodies[k], &members)),
            };
            filled.push(Filled {
                numbers,
                bonding: bonding.map_err(|e| e.in_body(k, &bodies))?,
                overlap: mean_overlap(&members, period),
                steps: 0,
                spheres: members,
            });
        }
        Self::assemble(&container, &bodies, &filled, spheres.len(), loose == Loose::Keep)
    }
}

/// Returns the body of each sphere: the body that contains its centre, or the nearest one.
fn homes(bodies: &[Container], spheres: &[Sphere], reach: f64) -> Vec<usize> {
    let home = |s: &Sphere| {
        let x = centre(s);
        let height = |b: &Container| match b.contains(&x) {
            true => f64::INFINITY,
            // Minus the depth outside of the wall; bodies without a wall within reach are excluded below.
            false => -b.gap(&x, reach).min(0.0).abs(),
        };
        let closeness = |b: &Container| match b.gap(&x, reach) >= reach && !b.contains(&x) {
            true => f64::NEG_INFINITY,
            false => height(b),
        };
        let best = (0..bodies.len()).max_by(|&a, &b| {
            closeness(&bodies[a])
                .total_cmp(&closeness(&bodies[b]))
                .then(b.cmp(&a))
        });
        best.unwrap_or_default()
    };
    match bodies.len() {
        1 => vec![0; spheres.len()],
        _ => spheres.iter().map(home).collect(),
    }
}

fn refuse_overlapping(spheres: &[Sphere], period: Option<[f64; 3]>) -> Result<()> {
    for (gap, [i, j]) in super::bonding::near_pairs(spheres, 0.0, period) {
        let (first, second) = (i as usize, j as usize);
        // `gap + 1` is the distance of the centres over the sum of the radii.
        let touch = spheres[first][3] + spheres[second][3];
        if gap + 1.0 <= COINCIDENT {
            return Err(Error::CoincidentParticles {
                first,
                second,
                distance: (gap + 1.0) * touch,
                limit: COINCIDENT * touch,
            });
        }
        let (distance, limit) = ((gap + 1.0) * touch, spheres[first][3].max(spheres[second][3]));
        if distance < limit {
            return Err(Error::Overlapping {
                first,
                second,
                distance,
                limit,
            });
        }
    }
    Ok(())
}

/// Returns the mean overlap of touching pairs over the mean diameter.
fn mean_overlap(spheres: &[Sphere], period: Option<[f64; 3]>) -> f64 {
    let touching = super::bonding::near_pairs(spheres, 0.0, period);
    let total: f64 = touching
        .iter()
        .map(|(gap, [i, j])| -gap * (spheres[*i as usize][3] + spheres[*j as usize][3]))
        .sum();
    let mean = mean_radius(spheres);
    total / touching.len().max(1) as f64 / (2.0 * mean)
}
