//! `kind = "chain"`: masses and springs along x.

use crate::error::{Result, core, value};
use crate::setup::body::Body;
use crate::setup::clock::SetupClock;
use crate::setup::kind::{Feature, Kind, Order, WHOLE};
use crate::setup::materials::elastic;
use crate::setup::mesh::{self, Grid};
use crate::setup::{BodyShape, LoweredModel};
use crate::spec::{Load, RoleKind, Shape};
use arlequin::core::{FineModel, Model};
use spring_chain::Chain as SpringChain;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Masses and springs along x.
pub(super) struct Chain;

impl Kind for Chain {
    fn name(&self) -> &'static str {
        "chain"
    }

    fn meaning(&self) -> &'static str {
        "Masses `ρ S r` (half at the ends) and springs `E S/r` along x; shape `bar`, role `fine` only."
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn refusal(&self, feature: Feature) -> Option<&'static str> {
        match feature {
            Feature::Crack => Some("a chain that is cut is two chains; write two models"),
            Feature::CoarseSide => Some("is discrete and can only be fine; put a fem model between"),
            Feature::Zone => Some("a chain is a line and fills no zone; take \"fem\", \"cnem\" or \"dem\""),
            Feature::Partition => Some(WHOLE),
            Feature::Volumes | Feature::Sleep => None,
        }
    }

    fn carries(&self, load: &Load) -> bool {
        load.force.is_some()
    }

    fn check(&self, order: &Order<'_>) -> Result<()> {
        line(order.key, order.table).map(|_| ())
    }

    fn build(&self, order: &Order<'_>, _: &mut SetupClock<'_>) -> Result<Body> {
        let Order { name, key, table, .. } = *order;
        let (from, to, section, bonds) = line(key, table)?;
        let spacing = (to - from) / bonds as f64;
        let main = table.known_material(key)?;
        let mass = main.density * section * spacing;
        let stiffness = main.young * section / spacing;
        let material = elastic(key, main)?;
        let model = SpringChain::new(name, from, spacing, bonds, mass, stiffness);
        let model = model.and_then(|c| c.with_section(section)).map_err(core(key))?;
        let ends = [("x-min", vec![0]), ("x-max", vec![bonds])];
        Ok(Body {
            field: model.fine_field(),
            grid: Arc::new(Grid::of_line(model.nodes())),
            model: Box::new(model),
            solver: None,
            groups: ends.map(|(n, k)| (n.to_owned(), k)).into_iter().collect(),
            surfaces: BTreeMap::new(),
            boundary: Vec::new(),
            spacing,
            material: Some(material),
            materials: Some(material.into()),
            shape: table.shape.clone(),
            grains: None,
            warnings: Vec::new(),
        })
    }
}

/// Ends \[m\], section \[m²\] and number of bonds of a chain.
fn line(key: &str, table: &LoweredModel) -> Result<(f64, f64, f64, usize)> {
    let BodyShape::Given(Shape::Bar { from, to, section }) = table.shape else {
        return Err(value(
            format!("{key}.shape"),
            table.shape.name(),
            "a chain is a line; use the shape bar, or another kind of model",
        ));
    };
    if table.role == Some(RoleKind::Coarse) {
        return Err(value(
            format!("{key}.role"),
            "coarse",
            "a chain is discrete and can only be fine; give the coarse role to a fem model",
        ));
    }
    if (table.scale - 1.0).abs() > 0.0 {
        let rule = "is for a shape from a file; remove it";
        return Err(value(format!("{key}.scale"), table.scale, rule));
    }
    mesh::check_bar(key, from, to, section)?;
    let bonds = mesh::divisions_of(key, &[to - from], table.spacing, table.divisions.as_deref())?[0];
    Ok((from, to, section, bonds))
}
