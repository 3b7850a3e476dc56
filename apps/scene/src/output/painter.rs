//! Draws a model at one instant as arrays of its points and cells.

use super::fields;
use super::pieces::Piece;
use super::writer::Array;
use crate::cells::{self, Cell};
use crate::error::{Result, core};
use crate::setup::{Grid, ModelInfo};
use crate::spec::OutputField;
use arlequin::core::Subdomain;
use arlequin::core::nalgebra::Point3;
use arlequin::dem_beam::fracture::{BreakLog, SharedLog, locked};
use std::borrow::Cow;
use std::sync::Arc;

/// Array of what sleeps.
pub(super) const ASLEEP: &str = "asleep [-]";

/// Everything about a model that does not change between its files.
#[derive(Debug)]
pub(super) struct Painter {
    /// Grid of the model, or of the part that this rank shows.
    pub(super) grid: Arc<Grid>,
    /// Part of a partitioned model that this rank shows, if each rank shows its own.
    pub(super) piece: Option<Piece>,
    /// Cells in which the energy density is computed; `None` if it is not asked for or comes from bonds, if
    /// the field has no gradient or if the material is unknown.
    centres: Option<Vec<Cell>>,
    weights: Vec<Array<'static>>,
    /// Log of broken bonds, if bonds can break.
    breaks: Option<SharedLog>,
    /// Bytes of recovered fields in a frame.
    recovered: usize,
}

/// Arrays of the points, then of the cells.
type PointsAndCells<'a> = (Vec<Array<'a>>, Vec<Array<'a>>);

/// Displacements and velocities of all points that are shown.
pub(super) struct Seen<'a> {
    q: Cow<'a, [f64]>,
    v: Cow<'a, [f64]>,
}

impl<'a> Seen<'a> {
    /// Gathers the state of a partitioned model: of `piece`, or without one of the whole model on rank 0
    /// (`None` elsewhere). Collective.
    pub(super) fn gather(s: &'a Subdomain<f64>, piece: Option<&Piece>) -> Result<Option<Self>> {
        let state = s.state();
        let gathered = |x: &'a [f64]| match piece {
            None => s.gather(x).map_err(core("output")),
            Some(piece) => {
                let layout = s.model().layout();
                let moving = &x[..layout.translations()];
                Ok(Some(piece.with_ghosts(layout.components, moving)?.into()))
            }
        };
        let (q, v) = (gathered(&state.q)?, gathered(&state.v)?);
        Ok(q.zip(v).map(|(q, v)| Self { q, v }))
    }
}

impl Painter {
    pub(super) fn new(
        fields: &[OutputField],
        info: ModelInfo,
        s: &Subdomain<f64>,
        mut piece: Option<Piece>,
    ) -> Self {
        let model_cells = || {
            let wanted =
                fields.contains(&OutputField::EnergyDensity) && !fields::energy_from_bonds(fields, s);
            let cells = wanted.then(|| cells::cells("output.fields", &info).ok());
            cells.flatten().filter(|c| !c.is_empty())
        };
        Self {
            centres: match &mut piece {
                Some(piece) => piece.centres.take(),
                None => model_cells(),
            },
            weights: weights(s, &info.grid.points),
            recovered: fields::bytes(fields, s, info.breaks.is_some()),
            grid: info.grid,
            breaks: info.breaks,
            piece,
        }
    }

    /// Bytes of one frame, without headers.
    pub(super) fn bytes(&self, fields: &[OutputField]) -> usize {
        let fixed = 24 * self.grid.points.len() + 4 * self.grid.connectivity.len() + 5 * self.grid.cells();
        let weights = if fields.contains(&OutputField::Weights) {
            12
        } else {
            0
        };
        let densities = self.centres.as_ref().map_or(0, Vec::len);
        let damage = match self.breaks {
            Some(_) => self.grid.points.len() + self.grid.cells(),
            None => 0,
        };
        fixed
            + (48 + weights) * self.grid.points.len()
            + 4 * (densities + damage)
            + 8 * self.grid.radii.len()
            + self.recovered
    }

    /// Returns the arrays of the points, then of the cells. Collective for a partitioned model.
    pub(super) fn arrays<'a>(
        &'a self,
        fields: &[OutputField],
        s: &'a Subdomain<f64>,
        seen: Seen<'a>,
    ) -> Result<PointsAndCells<'a>> {
        let (mut points, mut cells) = (Vec::new(), Vec::new());
        let count = s.model().layout().components;
        let vector = |name: &str, values: Cow<'a, [f64]>| Array {
            name: name.into(),
            components: 3,
            derived: false,
            values: vectors(values, count, self.grid.points.len()),
        };
        if !self.grid.radii.is_empty() {
            points.push(Array {
                derived: false,
                ..Array::scalar("radius [m]", &self.grid.radii)
            });
        }
        for field in fields {
            match (field, &self.centres) {
                (OutputField::Displacement, _) => points.push(vector("displacement [m]", seen.q.clone())),
                (OutputField::Velocity, _) => points.push(vector("velocity [m/s]", seen.v.clone())),
                // Those of a model that may sleep change.
                (OutputField::Weights, _) if s.has_sleep() => points.extend(weights(s, &self.grid.points)),
                (OutputField::Weights, _) => points.extend(self.weights.iter().map(|w| Array {
                    values: (&*w.values).into(),
                    name: w.name.clone(),
                    components: w.components,
                    derived: w.derived,
                })),
                (OutputField::EnergyDensity, Some(centres)) => {
                    let densities = centres.iter().map(|cell| density(cell, &seen.q, count));
                    cells.push(Array::scalar(
                        fields::ENERGY_DENSITY,
                        densities.collect::<Vec<f64>>(),
                    ));
                }
                _ => {}
            }
        }
        let piece = self.piece.as_ref();
        let mut survey = fields::survey(fields, s)?;
        let mut loads = fields::recovered(fields, s, survey.as_mut(), piece)?;
        loads.extend(fields::energy_densities(fields, s, survey.as_mut(), piece)?);
        let mut bonds = fields::bonds(fields, s, survey, self.grid.cells(), piece)?;
        if s.has_sleep() {
            let [nodes, elements] = self.asleep(s);
            silence(&mut loads, &self.stale(&nodes));
            silence(&mut bonds, &elements);
            points.push(Array::scalar(ASLEEP, nodes));
            cells.push(Array::scalar(ASLEEP, elements));
        }
        points.extend(loads);
        cells.extend(bonds);
        if let Some(log) = &self.breaks {
            let [shares, broken] = self.damage(&locked(log));
            let shares = match piece {
                Some(_) => fields::at_points(s, piece, 1, shares)?,
                None => shares,
            };
            points.push(Array::scalar("damage [-]", shares));
            cells.push(Array::scalar("broken [-]", broken));
        }
        Ok((points, cells))
    }

    /// 1 for each node that sleeps, and for each cell with such a node: their states are those of when they
    /// fell asleep.
    fn asleep(&self, s: &Subdomain<f64>) -> [Vec<f64>; 2] {
        let flag = |asleep: bool| f64::from(u8::from(asleep));
        let nodes = 0..self.grid.points.len();
        let cells = self.grid.connectivity.chunks_exact(self.grid.corners);
        [
            nodes.map(|k| flag(s.is_asleep(k))).collect(),
            cells
                .map(|c| flag(c.iter().any(|k| s.is_asleep(*k as usize))))
                .collect(),
        ]
    }

    /// 1 for each node whose stress has a part that sleeps: nodes that sleep, and those of the cells of a
    /// mesh around them. Spheres have that of their bonds that are awake.
    fn stale(&self, asleep: &[f64]) -> Vec<f64> {
        let mut out = asleep.to_vec();
        if self.grid.radii.is_empty() {
            let cells = self.grid.connectivity.chunks_exact(self.grid.corners);
            for cell in cells.filter(|c| c.iter().any(|k| asleep[*k as usize] > 0.0)) {
                cell.iter().for_each(|k| out[*k as usize] = 1.0);
            }
        }
        out
    }

    /// Mean damage of the bonds of every particle (of a part: of the owned ones), and the damage of each
    /// bond: 1 for a broken one.
    fn damage(&self, log: &BreakLog) -> [Vec<f64>; 2] {
        let points = self.piece.as_ref().map_or(self.grid.points.len(), |p| p.owned);
        let mut counts = vec![[0.0_f64; 2]; points];
        let mut count = |particle: u32, bond: usize| {
            let c = &mut counts[particle as usize];
            c[0] += log.damage(bond);
            c[1] += 1.0;
        };
        let gone = |bond: usize| log.damage(bond);
        let broken = match &self.piece {
            Some(piece) => {
                piece.bonds.iter().for_each(|[i, b]| count(*i, *b as usize));
                piece.cells.iter().map(|b| gone(*b as usize)).collect()
            }
            None => {
                for (b, pair) in self.grid.connectivity.chunks_exact(2).enumerate() {
                    pair.iter().for_each(|i| count(*i, b));
                }
                (0..self.grid.cells()).map(gone).collect()
            }
        };
        // A particle without bonds has no damage.
        let shares = counts.iter().map(|[gone, all]| gone / all.max(1.0)).collect();
        [shares, broken]
    }
}

/// Sets what sleeps to zero: its strains are stale.
fn silence(arrays: &mut [Array<'_>], asleep: &[f64]) {
    for array in arrays {
        let rows = array.values.to_mut().chunks_exact_mut(array.components);
        let stale = rows.zip(asleep).filter(|(_, asleep)| **asleep > 0.0);
        stale.for_each(|(values, _)| values.fill(0.0));
    }
}

/// Unweighted strain energy density `½ σ:ε` at a cell centre.
fn density(cell: &Cell, q: &[f64], count: usize) -> f64 {
    let h = cell.gradient(q, count);
    if count == 1 {
        return 0.5 * cell.material.young() * h[(0, 0)] * h[(0, 0)];
    }
    let [lambda, mu] = cell.material.lame();
    let strain = (h + h.transpose()) * 0.5;
    0.5 * lambda * strain.trace().powi(2) + mu * strain.norm_squared()
}

fn weights(s: &Subdomain<f64>, points: &[Point3<f64>]) -> Vec<Array<'static>> {
    let w = s.weights();
    let named = [
        ("alpha", &w.internal),
        ("beta", &w.kinetic),
        ("gamma", &w.external),
    ];
    named
        .map(|(name, w)| Array::scalar(name, points.iter().map(|x| w.value(x)).collect::<Vec<f64>>()))
        .into()
}

/// Returns the first values, which are those of points; pads the components of a model with zeros to three
/// per point.
pub(super) fn vectors(values: Cow<'_, [f64]>, components: usize, points: usize) -> Cow<'_, [f64]> {
    if components == 3 {
        return match values {
            Cow::Borrowed(values) => values[..3 * points].into(),
            Cow::Owned(mut values) => {
                values.truncate(3 * points);
                values.into()
            }
        };
    }
    (0..points)
        .flat_map(|k| (0..3).map(move |c| (k, c)))
        .map(|(k, c)| {
            if c < components {
                values[k * components + c]
            } else {
                0.0
            }
        })
        .collect()
}
