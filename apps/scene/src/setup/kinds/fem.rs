//! `kind = "fem"`: linear finite elements.

use crate::error::{Result, fem};
use crate::setup::body::Body;
use crate::setup::clock::SetupClock;
use crate::setup::kind::{Kind, Order};
use crate::setup::materials::{self, elastic};
use crate::setup::mesh::{Elements, Grid, Request};
use crate::setup::slit;
use arlequin::core::CoarseModel;
use arlequin::fem_ref::FemModel;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Linear finite elements.
pub(super) struct Fem;

impl Kind for Fem {
    fn name(&self) -> &'static str {
        "fem"
    }

    fn meaning(&self) -> &'static str {
        "Linear finite elements."
    }

    fn elements(&self) -> Option<Elements> {
        Some(Elements::Any)
    }

    fn check(&self, order: &Order<'_>) -> Result<()> {
        Request::of_model(order.key, order.table, Elements::Any, order.folder)?.check_body()
    }

    fn build(&self, order: &Order<'_>, _: &mut SetupClock<'_>) -> Result<Body> {
        let Order { name, key, table, .. } = *order;
        let request = Request::of_model(key, table, Elements::Any, order.folder)?;
        let mesh = slit::cut(key, table, request.mesh()?)?;
        let material = elastic(key, table.known_material(key)?)?;
        let mut groups = BTreeMap::new();
        let mut surfaces = BTreeMap::new();
        for (n, g) in mesh.groups() {
            groups.insert(n.clone(), g.nodes.iter().map(|&k| k as usize).collect());
            if !g.facets.is_empty() {
                surfaces.insert(n.clone(), mesh.surface(n).map_err(fem(key))?);
            }
        }
        let boundary = mesh.surface_where(|_| true);
        let mut warnings = materials::warnings(table, &mesh);
        let materials = materials::element_materials(key, table, &mesh)?;
        let grid = Grid::of_mesh(&mesh);
        let spacing = mesh.spacing();
        let model = FemModel::new(name, mesh, materials.clone()).map_err(fem(key))?;
        warnings.extend(model.warnings());
        Ok(Body {
            field: model.coarse_field(),
            model: Box::new(model),
            solver: None,
            grid: Arc::new(grid),
            groups,
            surfaces,
            boundary,
            spacing,
            material: Some(material),
            materials: Some(materials),
            shape: table.shape.clone(),
            grains: None,
            warnings,
        })
    }
}
