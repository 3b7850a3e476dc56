//! Building of an interface from an overlap and data of its two models, at set-up and again when a zone
//! moves.

use super::body::{Body, fastest};
use super::interface::{BuiltInterface, Sides, junction, options, weights};
use super::mediator::mediator;
use super::mesh::{Grid, Request};
use crate::error::Result;
use crate::setup::{BodyShape, LoweredInterface};
use crate::spec::Absorber as AbsorberTable;
use arlequin::core::effect::Absorber;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Elastic, InterfaceOptions, InterfaceSpec, Interpolation, Mediator, NoMediator, Overlap, Place,
};
use arlequin::fem_ref::FemField;
use std::path::Path;
use std::sync::Arc;

/// Default absorber for a fine model whose bonds can break: waves from breaking bonds would otherwise run
/// back and forth in the overlap, and their amplitude is highest where the weight is least.
const BRITTLE_ABSORBER: AbsorberTable = AbsorberTable {
    rate: None,
    rate_factor: Some(0.2),
    spacing: None,
};

/// Data of the two models of an interface that its parts depend on.
#[derive(Debug, Clone)]
pub(crate) struct Partners {
    /// Numbers of the coarse and the fine model.
    pub models: [usize; 2],
    /// Length of the coarse model's elements \[m\].
    spacing: f64,
    brittle: [bool; 2],
    options: InterfaceOptions<f64>,
    /// Absorber and its rate \[1/s\]; `None` if there is none.
    absorber: Option<(AbsorberTable, f64)>,
}

impl Partners {
    pub(super) fn new(path: &str, table: &LoweredInterface, sides: Sides<'_>) -> Result<Self> {
        let brittle = sides.map(|s| s.1.grains.as_ref().is_some_and(|g| g.brittle));
        let standard = brittle[1].then_some(&BRITTLE_ABSORBER);
        let absorber = match table.absorber.as_ref().or(standard) {
            // A rate of zero switches the default absorber off.
            Some(a) if a.rate != Some(0.0) => Some((a.clone(), rate(path, a, sides[1].1)?)),
            _ => None,
        };
        Ok(Self {
            models: sides.map(|s| s.0),
            spacing: sides[0].1.spacing,
            brittle,
            options: options(table, sides),
            absorber,
        })
    }

    /// Returns whether the interface has an absorber.
    pub(super) fn has_absorber(&self) -> bool {
        self.absorber.is_some()
    }

    /// Builds the interface `name` of a table for an overlap and the shape of its mediator.
    pub(super) fn tie(
        self,
        name: &str,
        (table, folder): (&LoweredInterface, &Path),
        (overlap, shape): (&Arc<dyn Overlap<f64>>, &BodyShape),
    ) -> Result<BuiltInterface> {
        let path = format!("interface.{name}");
        let mediator_path = format!("{path}.mediator");
        let request = mediator(&mediator_path, table, shape, self.spacing, folder);
        let (mediator, grid): (Arc<dyn Mediator<f64>>, Grid) = match shape {
            BodyShape::Piece(piece) if piece.is_empty(folder)? => (Arc::new(NoMediator), Grid::empty()),
            _ => {
                let mesh = request.mesh()?;
                let grid = Grid::of_mesh(&mesh);
                (Arc::new(FemField::new(mesh)), grid)
            }
        };
        let nodes = Some(mediator.nodes()).filter(|nodes| !nodes.is_empty());
        let weights = weights(&path, &table.weight, overlap, nodes, self.brittle)?;
        let absorber = match &self.absorber {
            Some((a, rate)) => Some(absorber(&path, (a, *rate), request, &mediator, overlap)?),
            None => None,
        };
        let spacing = nodes.map_or(self.spacing, |_| mediator.spacing());
        let junction = junction(&path, table, spacing)?;
        Ok(BuiltInterface {
            spec: InterfaceSpec {
                name: name.to_owned(),
                coarse: self.models[0],
                fine: self.models[1],
                mediator,
                junction,
                options: self.options,
            },
            weights,
            partition: table.partition,
            grid,
            absorber,
            advice: Vec::new(),
            partners: self,
        })
    }
}

/// Rate of an absorber on a fine model \[1/s\].
fn rate(path: &str, table: &AbsorberTable, fine: &Body) -> Result<f64> {
    match (table.rate, table.rate_factor) {
        (Some(r), _) => Ok(r),
        (None, factor) => {
            let fastest = fastest(&format!("{path}.absorber"), fine, Elastic::bar_speed)?;
            Ok(factor.unwrap_or_default() * fastest / fine.spacing)
        }
    }
}

fn absorber(
    path: &str,
    (table, rate): (&AbsorberTable, f64),
    mediator_request: Request<'_>,
    mediator: &Arc<dyn Mediator<f64>>,
    overlap: &Arc<dyn Overlap<f64>>,
) -> Result<Absorber<f64>> {
    let path = format!("{path}.absorber");
    let resolved: Arc<dyn Interpolation<f64>> = match table.spacing {
        None => mediator.clone(),
        Some(h) => {
            let request = Request {
                key: &path,
                spacing: Some(h),
                divisions: None,
                ..mediator_request
            };
            Arc::new(FemField::new(request.mesh()?))
        }
    };
    let overlap = overlap.clone();
    // Grows smoothly from zero at the border to the fine region, so that the absorber itself reflects no
    // waves.
    let field = move |x: &Point3<f64>| match overlap.place(x) {
        Place::Fine => 0.0,
        Place::Coarse => rate,
        Place::Overlap(s) => rate * s * s,
    };
    Ok(Absorber::new(resolved, Arc::new(field)))
}
