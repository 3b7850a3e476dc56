//! Materials of models, and of the volumes of a mesh file.

use crate::error::{Result, core, unknown, value};
use crate::setup::{BodyShape, LoweredModel};
use crate::spec::Material;
use arlequin::core::{Elastic, Materials};
use arlequin::fem_ref::{Mesh, list_pieces};

/// Materials of the elements: the one given for the volume of the element, otherwise the main one of the
/// table.
pub(super) fn element_materials(key: &str, table: &LoweredModel, mesh: &Mesh<f64>) -> Result<Materials<f64>> {
    let table_material = table.known_material(key)?;
    let main = elastic(key, table_material)?;
    if table.materials.is_empty() {
        return Ok(main.into());
    }
    // Number 0 is the main material; volumes that the table does not name keep it.
    let (mut materials, mut number) = (vec![main], vec![0; mesh.volumes().len()]);
    for (name, material) in &table.materials {
        let path = format!("{key}.materials.{name}");
        let volume = mesh.volumes().iter().position(|v| v == name);
        let volume = volume.ok_or_else(|| {
            unknown(
                format!("{key}.materials"),
                name,
                "volume of the mesh file",
                mesh.volumes().iter(),
            )
        })?;
        number[volume] = materials.len() as u32;
        materials.push(of_volume(&path, table_material, material)?);
    }
    let numbers = mesh.regions().iter().map(|r| number[*r as usize]);
    Materials::of_elements(materials, numbers.collect()).map_err(core(format!("{key}.materials")))
}

/// Material of a volume; without its own Poisson's ratio it takes that of the main material.
fn of_volume(path: &str, main: &Material, material: &Material) -> Result<Elastic<f64>> {
    let whole = Material {
        poisson: material.poisson.or(main.poisson),
        ..*material
    };
    elastic_at(path, &whole)
}

/// Warnings about a mesh: notices of the reader, volumes that share a single material, unconnected pieces.
pub(super) fn warnings(table: &LoweredModel, mesh: &Mesh<f64>) -> Vec<String> {
    let mut out: Vec<String> = mesh
        .notices()
        .iter()
        .map(|n| format!("its mesh file: {n}"))
        .collect();
    out.extend(one_material(table, mesh));
    out.extend(pieces(table, mesh));
    out
}

/// Warning if the mesh has pieces that share no node; none for zones, which may divide a body.
fn pieces(table: &LoweredModel, mesh: &Mesh<f64>) -> Option<String> {
    if matches!(table.shape, BodyShape::Piece(_)) {
        return None;
    }
    let pieces = mesh.pieces();
    (pieces.len() > 1).then(|| {
        format!(
            "its mesh is in {} pieces that share no node and move without each other: {}; join them in the mesh, hold each of \
             them, or take a model of each",
            pieces.len(),
            list_pieces(&pieces)
        )
    })
}

fn one_material(table: &LoweredModel, mesh: &Mesh<f64>) -> Option<String> {
    let mut volumes: Vec<&str> = mesh
        .regions()
        .iter()
        .map(|r| mesh.volumes()[*r as usize].as_str())
        .collect();
    volumes.sort_unstable();
    volumes.dedup();
    if volumes.len() < 2 || !table.materials.is_empty() {
        return None;
    }
    Some(format!(
        "its mesh file has {} volumes ({}), and all get the one material of the model; say what they are made of in \
         materials.NAME, or check that they are alike",
        volumes.len(),
        volumes.join(", ")
    ))
}

/// Material of a table; Poisson's ratio is zero if the table has none.
pub(super) fn elastic(key: &str, m: &Material) -> Result<Elastic<f64>> {
    elastic_at(&format!("{key}.material"), m)
}

/// Material with the key path `key`; Poisson's ratio is zero if it has none.
pub(super) fn elastic_at(key: &str, m: &Material) -> Result<Elastic<f64>> {
    for (name, x, unit) in [("young", m.young, "Pa"), ("density", m.density, "kg/m³")] {
        if x <= 0.0 {
            let rule = format!("must be positive [{unit}]");
            return Err(value(format!("{key}.{name}"), x, &rule));
        }
    }
    match m.poisson {
        Some(nu) if !(nu > -1.0 && nu < 0.5) => Err(value(
            format!("{key}.poisson"),
            nu,
            "must lie above -1 and below 0.5; nearly incompressible materials lock elements of first order, and a warning says how \
             far: take 0.45 or less, or a finer mesh",
        )),
        nu => Elastic::new(m.young, nu.unwrap_or(0.0), m.density).map_err(core(key)),
    }
}

/// Refuses a solid without Poisson's ratio.
pub(super) fn solid_poisson(key: &str, table: &LoweredModel) -> Result<()> {
    table.known_material(key)?.poisson.map(|_| ()).ok_or_else(|| {
        crate::error::key(
            format!("{key}.material"),
            "a solid needs poisson, Poisson's ratio [-]; add poisson = 0.3 or what the material has",
        )
    })
}
