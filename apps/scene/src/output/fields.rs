//! Fields that models recover (stresses, strains, bond forces, …), as arrays of a frame.

use super::pieces::Piece;
use super::writer::Array;
use crate::error::{Result, core};
use crate::spec::OutputField;
use arlequin::core::{Coupled, LinkSurvey, Owned, Subdomain, SymmetricTensor};
use rayon::prelude::*;
use std::borrow::Cow;

/// Components of a symmetric tensor as viewers of VTU files name them: xx, yy, zz, xy, yz, xz.
const TENSOR: usize = 6;

/// Name of the array of strain energy densities, at particles and in elements.
pub(super) const ENERGY_DENSITY: &str = "energy density [J/m3]";

/// Returns how many numbers a node has of a field that needs stresses or strains, and 0 for other fields.
fn width(field: OutputField) -> usize {
    match field {
        OutputField::Stress | OutputField::Strain => TENSOR,
        OutputField::VonMises => 1,
        OutputField::PrincipalStress => 3,
        _ => 0,
    }
}

/// Size of the recovered fields in one frame of a model, bonds included \[bytes\]. `brittle`: whether bonds
/// can break.
pub(super) fn bytes(fields: &[OutputField], s: &Subdomain<f64>, brittle: bool) -> usize {
    let nodes = s.model().views().recovery.map_or(0, |r| {
        let is_known = |f: &&OutputField| **f != OutputField::Strain || r.has_strain();
        s.model().nodes().len() * fields.iter().filter(is_known).map(|f| width(*f)).sum::<usize>()
    });
    let bonds = s.model().views().links.map_or(0, |l| l.pairs().len());
    let densities = match energy_from_bonds(fields, s) {
        true => s.model().nodes().len(),
        false => 0,
    };
    // In single precision.
    4 * (nodes
        + densities
        + if fields.contains(&OutputField::BondForces) {
            // Without fracture they have no utilisation.
            (WIDTH - usize::from(!brittle)) * bonds
        } else {
            0
        })
}

/// Gathers `local_values`, with `components` numbers per node of this rank, for the points that are shown:
/// all points of a model that is not partitioned, the points of `piece`, or without a piece the whole model
/// on rank 0 (empty elsewhere). Collective.
pub(super) fn at_points(
    s: &Subdomain<f64>,
    piece: Option<&Piece>,
    components: usize,
    local_values: Vec<f64>,
) -> Result<Vec<f64>> {
    if let Some(piece) = piece {
        return piece.with_ghosts(components, &local_values);
    }
    let owned = s.owned();
    if !owned.is_part() {
        return Ok(local_values);
    }
    let gathered = owned.gather(components, &local_values).map_err(core("ranks"))?;
    Ok(gathered.map(Cow::into_owned).unwrap_or_default())
}

/// Reads all bonds of a model once, if it has bonds and a field needs them. Collective.
pub(super) fn survey(fields: &[OutputField], s: &Subdomain<f64>) -> Result<Option<LinkSurvey<f64>>> {
    let needs =
        |f: &OutputField| width(*f) > 0 || matches!(f, OutputField::EnergyDensity | OutputField::BondForces);
    let links = s.model().views().links.filter(|_| fields.iter().any(needs));
    let read = links.map(|l| l.survey(&s.state().q)).transpose();
    read.map_err(core(format!("output.fields of model '{}'", s.model().name())))
}

/// Stresses and strains at the nodes, as far as `fields` asks for them and the model has them; see
/// [`at_points`].
pub(super) fn recovered(
    fields: &[OutputField],
    s: &Subdomain<f64>,
    survey: Option<&mut LinkSurvey<f64>>,
    piece: Option<&Piece>,
) -> Result<Vec<Array<'static>>> {
    let wanted = fields.iter().any(|f| width(*f) > 0);
    let Some(recovery) = s.model().views().recovery.filter(|_| wanted) else {
        return Ok(Vec::new());
    };
    let (mut stresses, mut strains) = match survey {
        Some(survey) => (std::mem::take(&mut survey.stresses), None),
        None => {
            let nodes: Vec<usize> = (0..s.model().nodes().len()).collect();
            let mut tensors = Vec::with_capacity(nodes.len());
            let result = recovery.recover(&s.state().q, &nodes, &mut tensors);
            result.map_err(core(format!("output.fields of model '{}'", s.model().name())))?;
            let strains: Option<Vec<_>> = tensors.iter().map(|r| r.strain).collect();
            (tensors.into_iter().map(|r| r.stress).collect(), strains)
        }
    };
    let mut out: Vec<(usize, Array<'static>)> = Vec::new();
    // Stresses last: their array takes over the memory of the tensors, of which the others are made.
    let is_stress = |k: &usize| fields[*k] == OutputField::Stress;
    let (last, first): (Vec<usize>, Vec<usize>) = (0..fields.len()).partition(is_stress);
    for k in first.into_iter().chain(last.first().copied()) {
        let field = fields[k];
        let (name, values) = match field {
            OutputField::Stress => ("stress [Pa]", flat(std::mem::take(&mut stresses))),
            OutputField::Strain => match strains.take() {
                Some(strains) => ("strain [-]", flat(strains)),
                None => continue,
            },
            OutputField::VonMises => (
                "von Mises stress [Pa]",
                stresses.par_iter().map(SymmetricTensor::von_mises).collect(),
            ),
            OutputField::PrincipalStress => {
                let principal: Vec<[f64; 3]> = stresses.par_iter().map(SymmetricTensor::principal).collect();
                ("principal stresses [Pa]", principal.into_flattened())
            }
            _ => continue,
        };
        let components = width(field);
        let array = Array {
            name: name.into(),
            components,
            derived: true,
            values: at_points(s, piece, components, values)?.into(),
        };
        out.push((k, array));
    }
    out.sort_by_key(|(k, _)| *k);
    Ok(out.into_iter().map(|(_, array)| array).collect())
}

/// Returns the components of tensors, in their memory.
fn flat(tensors: Vec<SymmetricTensor<f64>>) -> Vec<f64> {
    let rows: Vec<[f64; TENSOR]> = tensors.into_iter().map(|t| t.0).collect();
    rows.into_flattened()
}

/// Returns whether the energy density is asked for and comes from bonds. Otherwise it comes from the
/// gradients in the cells.
pub(super) fn energy_from_bonds(fields: &[OutputField], s: &Subdomain<f64>) -> bool {
    fields.contains(&OutputField::EnergyDensity) && s.model().views().links.is_some()
}

/// Unweighted strain energy density of the nodes of a model with bonds; see [`at_points`].
pub(super) fn energy_densities(
    fields: &[OutputField],
    s: &Subdomain<f64>,
    survey: Option<&mut LinkSurvey<f64>>,
    piece: Option<&Piece>,
) -> Result<Option<Array<'static>>> {
    let survey = survey.filter(|_| energy_from_bonds(fields, s));
    let Some(survey) = survey else { return Ok(None) };
    let values = at_points(s, piece, 1, std::mem::take(&mut survey.densities))?;
    Ok(Some(Array::scalar(ENERGY_DENSITY, values)))
}

/// Sum of the contact forces on every node of a model that has contact; see [`at_points`].
pub(super) fn contacts(
    fields: &[OutputField],
    run: &Coupled<f64>,
    model: usize,
    piece: Option<&Piece>,
) -> Result<Option<Array<'static>>> {
    let s = &run.subdomains()[model];
    let layout = s.model().layout();
    if !fields.contains(&OutputField::ContactForces) || layout.components != 3 {
        return Ok(None);
    }
    let mut forces = vec![0.0; layout.dofs()];
    let any = run.add_contact_forces(model, &mut forces);
    forces.truncate(layout.translations());
    forces.shrink_to_fit();
    if any {
        forces = at_points(s, piece, 3, forces)?;
    }
    Ok(any.then(|| Array {
        name: "contact force [N]".into(),
        components: 3,
        derived: true,
        values: forces.into(),
    }))
}

/// Numbers per bond.
const WIDTH: usize = 3;

/// Axial force, shear force and utilisation of a bond.
type Carried = [f64; WIDTH];

/// Gathers the numbers of all bonds on rank 0 (empty elsewhere), in the order of the whole model.
/// `local_bonds` has each bond whose first particle this rank owns, as that particle and the numbers, sorted
/// by particle.
fn gather_bonds(owned: &Owned, local_bonds: &[(usize, Carried)]) -> Result<Vec<Carried>> {
    let mut counts = vec![0.0; owned.nodes()];
    local_bonds.iter().for_each(|b| counts[b.0] += 1.0);
    // Every particle gets as many slots as the one with most bonds needs, because `collect` takes a fixed
    // number of values per node.
    let most = owned.largest(counts.iter().fold(0.0, |m: f64, c| m.max(*c))) as usize;
    let mut places = vec![0.0; WIDTH * most * owned.nodes()];
    for bonds in local_bonds.chunk_by(|a, b| a.0 == b.0) {
        let first = WIDTH * most * bonds[0].0;
        let numbers = bonds.iter().flat_map(|b| b.1);
        places[first..].iter_mut().zip(numbers).for_each(|(p, x)| *p = x);
    }
    let counts = owned.gather(1, &counts).map_err(core("ranks"))?;
    let places = owned.gather(WIDTH * most, &places).map_err(core("ranks"))?;
    let (Some(counts), Some(places)) = (counts, places) else {
        return Ok(Vec::new());
    };
    let numbers_of = |(k, count): (usize, &f64)| {
        let first = WIDTH * most * k;
        places[first..first + WIDTH * *count as usize]
            .as_chunks::<WIDTH>()
            .0
            .to_vec()
    };
    Ok(counts.iter().enumerate().flat_map(numbers_of).collect())
}

/// Forces of bonds, as arrays of the cells of a picture or of a part of it. Empty if the picture has not one
/// of its `cells` per bond.
pub(super) fn bonds(
    fields: &[OutputField],
    s: &Subdomain<f64>,
    survey: Option<LinkSurvey<f64>>,
    cells: usize,
    piece: Option<&Piece>,
) -> Result<Vec<Array<'static>>> {
    let wanted = fields.contains(&OutputField::BondForces);
    // A rank of a partitioned model has only some of the bonds, so that the count does not tell.
    let owned = s.owned();
    let survey = survey.filter(|l| wanted && (owned.is_part() || l.axial.len() == cells));
    let (Some(survey), Some(links)) = (survey, s.model().views().links) else {
        return Ok(Vec::new());
    };
    let mut columns = [
        ("axial force [N]", Some(survey.axial)),
        ("shear force [N]", Some(survey.shear)),
        ("utilisation [-]", survey.utilisation),
    ];
    if owned.is_part() {
        let lacks = owned.any(columns[2].1.is_none()).map_err(core("ranks"))?;
        let number = |c: usize, b: usize| columns[c].1.as_ref().map_or(0.0, |x| x[b]);
        let first_ends = links.pairs().iter().map(|p| p[0] as usize).enumerate();
        let local_bonds = first_ends.map(|(b, i)| (i, [0, 1, 2].map(|c| number(c, b))));
        let local_bonds: Vec<(usize, Carried)> = local_bonds.filter(|b| b.0 < owned.nodes()).collect();
        let rows: Vec<Carried> = match piece {
            Some(_) => local_bonds.iter().map(|b| b.1).collect(),
            None => gather_bonds(&owned, &local_bonds)?,
        };
        for (c, (_, column)) in columns.iter_mut().enumerate() {
            *column = (c < 2 || !lacks).then(|| rows.iter().map(|x| x[c]).collect());
        }
    }
    let known = columns
        .into_iter()
        .filter_map(|(name, column)| column.map(|c| Array::scalar(name, c)));
    Ok(known.collect())
}
