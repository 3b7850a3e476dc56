//! Frames: the state of all models and mediators at one instant.

use super::vtu::{self, Array, Entry};
use super::{fields, mark};
use crate::cells::{self, Cell};
use crate::error::{Error, Result, core, write};
use crate::ranks::heard;
use crate::setup::{Grid, ModelInfo, RigidPicture};
use crate::spec::OutputField;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Subdomain};
use arlequin::dem_beam::fracture::{BreakLog, SharedLog, locked};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Writes frames and, at the end, their index.
#[derive(Debug)]
pub struct Frames {
    /// None on a rank that writes nothing.
    folder: Option<PathBuf>,
    fields: Vec<OutputField>,
    models: Vec<Painter>,
    mediators: Vec<Grid>,
    rigid: Vec<RigidPicture>,
    entries: Vec<Entry>,
}

/// What frames show.
#[derive(Debug)]
pub struct Pictures {
    /// Models.
    pub models: Vec<ModelInfo>,
    /// Mediators.
    pub mediators: Vec<Grid>,
    /// Rigid bodies.
    pub rigid: Vec<RigidPicture>,
}

/// A model at one instant.
#[derive(Debug)]
pub struct Picture<'a> {
    /// Its name.
    pub name: String,
    /// Points and cells at rest.
    pub grid: &'a Grid,
    /// Values at the points.
    pub points: Vec<Array>,
    /// Values in the cells.
    pub cells: Vec<Array>,
}

/// Displacements and velocities of all of a model.
struct Seen<'a> {
    q: Cow<'a, [f64]>,
    v: Cow<'a, [f64]>,
}

impl<'a> Seen<'a> {
    /// Of a model in parts, on the first rank alone; all of them must ask.
    fn of(s: &'a Subdomain<f64>) -> Result<Option<Self>> {
        let state = s.state();
        if s.portion().is_none() {
            let (q, v) = (Cow::from(&state.q), Cow::from(&state.v));
            return Ok(Some(Self { q, v }));
        }
        let (q, v) = (in_all(s, &state.q)?, in_all(s, &state.v)?);
        let both = q.zip(v);
        Ok(both.map(|(q, v)| Self {
            q: q.into(),
            v: v.into(),
        }))
    }
}

fn in_all(s: &Subdomain<f64>, x: &[f64]) -> Result<Option<Vec<f64>>> {
    s.in_all(x).map_err(core("output"))
}

/// What a model's files repeat.
#[derive(Debug)]
struct Painter {
    grid: Arc<Grid>,
    /// Empty if the energy density is not wanted, the field has no gradient or the material is not known.
    centres: Vec<Cell>,
    weights: Vec<Array>,
    /// What broke, where bonds can.
    breaks: Option<SharedLog>,
    /// Bytes of recovered fields in a frame.
    recovered: usize,
}

impl Frames {
    /// Prepares frames in a folder.
    pub fn new(
        folder: Option<PathBuf>,
        fields: &[OutputField],
        run: &Coupled<f64>,
        pictures: Pictures,
    ) -> Self {
        let density = fields.contains(&OutputField::EnergyDensity);
        let models = pictures
            .models
            .into_iter()
            .zip(run.subdomains())
            .map(|(d, s)| Painter {
                centres: if density {
                    cells::cells("output.fields", &d).unwrap_or_default()
                } else {
                    Vec::new()
                },
                weights: weights(s, &d.grid.points),
                recovered: fields::bytes(fields, s),
                grid: d.grid,
                breaks: d.breaks,
            })
            .collect();
        Self {
            folder,
            fields: fields.to_vec(),
            models,
            mediators: pictures.mediators,
            rigid: pictures.rigid,
            entries: Vec::new(),
        }
    }

    /// Files written so far.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Goes on with the files written before; removes those of later instants.
    pub fn resume(&mut self, entries: Vec<Entry>) -> Result<()> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let kept: Vec<_> = entries
            .iter()
            .filter_map(|e| Path::new(&e.file).file_name())
            .collect();
        for file in std::fs::read_dir(folder).map_err(write(folder))?.flatten() {
            let name = file.file_name();
            if !kept.contains(&name.as_os_str()) && mark::is_frame(&name) {
                std::fs::remove_file(file.path()).map_err(write(&file.path()))?;
            }
        }
        self.entries = entries;
        Ok(())
    }

    /// Number of instants written.
    pub fn count(&self) -> usize {
        self.entries.iter().filter(|e| e.part == 0).count()
    }

    /// Bytes of one frame, without headers.
    pub fn bytes_per_frame(&self) -> usize {
        let model = |m: &Painter| {
            let fixed = 24 * m.grid.points.len() + 4 * m.grid.connectivity.len() + 9 * m.grid.cells();
            let weights = if self.fields.contains(&OutputField::Weights) {
                24
            } else {
                0
            };
            fixed
                + (48 + weights) * m.grid.points.len()
                + 8 * (m.centres.len() + m.grid.radii.len())
                + m.recovered
        };
        let mediator = |v: &Grid| 48 * v.points.len() + 8 * v.connectivity.len() + 9 * v.cells();
        self.models.iter().map(model).sum::<usize>() + self.mediators.iter().map(mediator).sum::<usize>()
    }

    /// A model in its current state, as [`Self::write`] puts it into a file; none beyond the last model, and of one in parts on
    /// ranks but the first, all of which must ask.
    ///
    /// # Errors
    /// Values that are not finite; what a model cannot recover.
    pub fn picture(&self, run: &Coupled<f64>, part: usize) -> Result<Option<Picture<'_>>> {
        let (Some(painter), Some(s)) = (self.models.get(part), run.subdomains().get(part)) else {
            return Ok(None);
        };
        check_state(run, s)?;
        let Some(seen) = Seen::of(s)? else {
            return Ok(None);
        };
        let name = s.model().name();
        let (mut points, cells) = painter.arrays(&self.fields, s, &seen)?;
        points.extend(fields::contacts(&self.fields, run, part)?);
        Ok(Some(Picture {
            name: name.to_owned(),
            grid: &painter.grid,
            points,
            cells,
        }))
    }

    /// Writes the current state.
    pub fn write(&mut self, run: &Coupled<f64>) -> Result<()> {
        let Some(folder) = self.folder.clone() else {
            // What the first rank asks of models in parts, in its order.
            for (part, s) in run.subdomains().iter().enumerate() {
                check_state(run, s)?;
                if s.portion().is_none() {
                    continue;
                }
                Seen::of(s)?;
                fields::recovered(&self.fields, s)?;
                fields::bonds(&self.fields, s, 0)?;
                fields::contacts(&self.fields, run, part)?;
            }
            return Ok(());
        };
        let mut part = 0;
        while let Some(p) = self.picture(run, part)? {
            let file = format!("{}_{:08}.vtu", p.name, run.steps());
            vtu::write_grid(&folder.join(&file), p.grid, &p.points, &p.cells)?;
            let written = entry(run, part, &p.name, file);
            self.entries.push(written);
            part += 1;
        }
        self.write_rigid(run, &folder)?;
        if !self.fields.contains(&OutputField::Multipliers) {
            return Ok(());
        }
        for (k, (grid, i)) in self.mediators.iter().zip(run.interfaces()).enumerate() {
            let name = &i.report().name;
            check_finite(run, name, i.multipliers())?;
            let lambda = Array {
                name: "multiplier".into(),
                components: 3,
                values: vectors(i.multipliers(), i.components(), grid.points.len()),
            };
            let file = format!("mediator-{name}_{:08}.vtu", run.steps());
            vtu::write_grid(&folder.join(&file), grid, &[lambda], &[])?;
            self.entries.push(entry(
                run,
                self.models.len() + k,
                &format!("mediator-{name}"),
                file,
            ));
        }
        Ok(())
    }

    /// Rigid bodies where they are at rest, with the displacement and velocity of every point.
    fn write_rigid(&mut self, run: &Coupled<f64>, folder: &Path) -> Result<()> {
        for (k, p) in self.rigid.iter().enumerate() {
            let mut effects = run.subdomains()[p.model].effects();
            let Some(now) = effects.find(|e| e.name() == p.name).and_then(|e| e.rigid()) else {
                continue;
            };
            let array = |name: &str, value: &dyn Fn(&Point3<f64>) -> Vector3<f64>| Array {
                name: name.into(),
                components: 3,
                values: p.grid.points.iter().flat_map(|x| value(x).data.0[0]).collect(),
            };
            let arrays = [
                array("displacement [m]", &|_| now.displacement),
                array("velocity [m/s]", &|x| {
                    now.velocity + now.spin.cross(&(x - p.centre))
                }),
            ];
            let model = run.subdomains()[p.model].model().name();
            let name = format!("rigid-{}-{model}", p.name);
            // Names of rigid bodies are free, those of files are not.
            let plain = |c: char| {
                if c.is_ascii_alphanumeric() || "-_".contains(c) {
                    c
                } else {
                    '-'
                }
            };
            let file = format!(
                "{}-{k}_{:08}.vtu",
                name.chars().map(plain).collect::<String>(),
                run.steps()
            );
            vtu::write_grid(&folder.join(&file), &p.grid, &arrays, &[])?;
            let part = self.models.len() + self.mediators.len() + k;
            self.entries.push(entry(run, part, &name, file));
        }
        Ok(())
    }

    /// Writes the index.
    pub fn finish(&self, path: &Path) -> Result<()> {
        vtu::write_index(path, &self.entries)
    }
}

impl Painter {
    fn arrays(
        &self,
        fields: &[OutputField],
        s: &Subdomain<f64>,
        seen: &Seen<'_>,
    ) -> Result<(Vec<Array>, Vec<Array>)> {
        let (mut points, mut cells) = (Vec::new(), Vec::new());
        let count = s.model().layout().components;
        let vector = |name: &str, values: &[f64]| Array {
            name: name.into(),
            components: 3,
            values: vectors(values, count, self.grid.points.len()),
        };
        if !self.grid.radii.is_empty() {
            points.push(Array {
                name: "radius [m]".into(),
                components: 1,
                values: self.grid.radii.clone(),
            });
        }
        for field in fields {
            match field {
                OutputField::Displacement => points.push(vector("displacement [m]", &seen.q)),
                OutputField::Velocity => points.push(vector("velocity [m/s]", &seen.v)),
                OutputField::Weights => points.extend(self.weights.iter().cloned()),
                OutputField::EnergyDensity if !self.centres.is_empty() => cells.push(Array {
                    name: "energy density [J/m3]".into(),
                    components: 1,
                    values: self
                        .centres
                        .iter()
                        .map(|cell| density(cell, &seen.q, count))
                        .collect(),
                }),
                _ => {}
            }
        }
        points.extend(fields::recovered(fields, s)?);
        cells.extend(fields::bonds(fields, s, self.grid.cells())?);
        if let Some(log) = &self.breaks {
            let (damage, broken) = self.damage(&locked(log));
            points.push(damage);
            cells.push(broken);
        }
        Ok((points, cells))
    }

    /// Share of broken bonds of every particle, and which bonds are broken.
    fn damage(&self, log: &BreakLog) -> (Array, Array) {
        let mut counts = vec![[0.0_f64; 2]; self.grid.points.len()];
        let mut broken = Vec::with_capacity(self.grid.cells());
        for (b, pair) in self.grid.connectivity.chunks_exact(2).enumerate() {
            let gone = f64::from(u8::from(log.is_broken(b)));
            broken.push(gone);
            for i in pair {
                let c = &mut counts[*i as usize];
                c[0] += gone;
                c[1] += 1.0;
            }
        }
        let array = |name: &str, values| Array {
            name: name.into(),
            components: 1,
            values,
        };
        let shares = counts.iter().map(|[gone, all]| gone / all.max(1.0)).collect();
        (array("damage [-]", shares), array("broken [-]", broken))
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

fn weights(s: &Subdomain<f64>, points: &[Point3<f64>]) -> Vec<Array> {
    let w = s.weights();
    let all = [
        ("alpha", &w.internal),
        ("beta", &w.kinetic),
        ("gamma", &w.external),
    ];
    all.map(|(name, w)| Array {
        name: name.into(),
        components: 1,
        values: points.iter().map(|x| w.at(x)).collect(),
    })
    .into()
}

/// Three components per point, whatever the model has.
fn vectors(values: &[f64], components: usize, points: usize) -> Vec<f64> {
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

fn entry(run: &Coupled<f64>, part: usize, name: &str, file: String) -> Entry {
    Entry {
        time: run.time(),
        part,
        name: name.to_owned(),
        file: format!("vtu/{file}"),
    }
}

/// Refuses displacements and velocities that are no numbers, on whatever rank they are: on all of them.
fn check_state(run: &Coupled<f64>, s: &Subdomain<f64>) -> Result<()> {
    let state = s.state();
    let finite = state.q.iter().chain(&state.v).all(|x| x.is_finite());
    let own = f64::from(u8::from(!finite));
    let worst = s.portion().map_or(own, |p| p.largest(own));
    heard(s)?;
    check_finite(run, s.model().name(), &[1.0 / (1.0 - worst)])
}

fn check_finite(run: &Coupled<f64>, name: &str, values: &[f64]) -> Result<()> {
    if values.iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::NotFinite {
        what: format!("a value of '{name}'"),
        time: run.time(),
    })
}
