//! How the packings of particle models came out, in numbers and in warnings.

use crate::setup::zone::Likeness;
use arlequin::dem_beam::packing::{Packing, narrow};
use serde::Serialize;

/// Largest share of the volume of spheres left out that goes without a warning.
const FEW_DROPPED: f64 = 0.005;
/// Shares of its volume that spheres fill in any packing of ours, walls included; files may bring others.
const FILLED: [f64; 2] = [0.45, 0.75];
/// Parts that are named by size in a warning.
const NAMED: usize = 6;

/// A packing in `check`, `run` and `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct PackingLine {
    /// Spheres asked for.
    pub asked: usize,
    /// Spheres placed, or read from a file.
    pub placed: usize,
    /// Of these, cut off beyond the border of a zone.
    pub beyond: usize,
    /// Of these, left out because no bonds join them to a part.
    pub dropped: usize,
    /// Their share of the volume of all placed; their body's other spheres are by so much heavier.
    pub dropped_share: f64,
    /// Spheres that no bonds join to a part and that stay as loose grains.
    pub grains: usize,
    /// Bodies of the shape.
    pub bodies: usize,
    /// Connected parts.
    pub parts: Vec<PartLine>,
    /// Bonds per sphere times two, over all placed.
    pub coordination_all: f64,
    /// The same over those that stayed.
    pub coordination_retained: f64,
    /// The same over those farther than two mean diameters from a wall, if there are any.
    pub coordination_interior: Option<f64>,
    /// Share of the shape that no sphere fills.
    pub void_fraction: f64,
    /// Mean diameters across the narrowest body.
    pub across: Option<f64>,
    /// What notches took.
    pub notch: NotchLine,
    /// Mass of all spheres \[kg\].
    pub mass: f64,
    /// That over density times volume of the shape.
    pub mass_ratio: f64,
    /// What the packing of a zone is like in its place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub likeness: Option<Likeness>,
}

/// A connected part.
#[derive(Debug, Clone, Serialize)]
pub struct PartLine {
    /// Body of the shape, from 1.
    pub body: usize,
    /// Spheres.
    pub spheres: usize,
    /// Mass \[kg\].
    pub mass: f64,
}

/// What notches took away.
#[derive(Debug, Clone, Serialize)]
pub struct NotchLine {
    /// Bonds.
    pub bonds: usize,
    /// Spheres they left without a bond to a part.
    pub spheres: usize,
    /// Mass of these \[kg\].
    pub mass: f64,
}

impl PackingLine {
    /// Of a packing, cut and all, in a material of this density \[kg/m³\].
    pub fn of(packing: &Packing, density: f64, likeness: Option<Likeness>) -> Self {
        let r = &packing.report;
        let parts = packing.parts().into_iter().map(|p| PartLine {
            body: p.body + 1,
            spheres: p.spheres,
            mass: density * p.volume,
        });
        let volume: f64 = packing.volumes().iter().sum();
        Self {
            asked: r.asked,
            placed: r.placed,
            beyond: r.beyond,
            dropped: r.dropped,
            dropped_share: r.dropped_share,
            grains: packing.grains(),
            bodies: r.bodies,
            parts: parts.collect(),
            coordination_all: r.coordination_all,
            coordination_retained: r.coordination_retained,
            coordination_interior: (r.coordination_interior > 0.0).then_some(r.coordination_interior),
            void_fraction: 1.0 - r.volume_fraction,
            across: r.across,
            notch: NotchLine {
                bonds: r.cut.bonds,
                spheres: r.cut.spheres,
                mass: density * r.cut.volume,
            },
            mass: density * volume,
            mass_ratio: volume / packing.volume,
            likeness,
        }
    }

    /// What a user should know.
    pub fn warnings(&self) -> Vec<String> {
        let mut out = Vec::new();
        if self.dropped_share > FEW_DROPPED {
            out.push(format!(
                "{} of {} spheres hang on no part and are left out; the others carry their mass, {:.2} % more each",
                self.dropped,
                self.placed,
                100.0 * self.dropped_share / (1.0 - self.dropped_share)
            ));
        }
        if self.parts.len() > self.bodies {
            let mut sizes: Vec<usize> = self.parts.iter().map(|p| p.spheres).collect();
            sizes.sort_unstable_by(|a, b| b.cmp(a));
            let named: Vec<String> = sizes.iter().take(NAMED).map(ToString::to_string).collect();
            let more = if sizes.len() > NAMED { ", ..." } else { "" };
            let bodies = match self.bodies {
                1 => "one body".to_owned(),
                n => format!("{n} bodies"),
            };
            out.push(format!(
                "the shape is {bodies}, its spheres are {} parts that no bond joins ({}{more} spheres), each with the mass of \
                 its own; they move apart freely, and without contact through each other",
                sizes.len(),
                named.join(", ")
            ));
        }
        let filled = 1.0 - self.void_fraction;
        if !(FILLED[0]..=FILLED[1]).contains(&filled) {
            out.push(format!(
                "spheres fill {:.1} % of the shape, packings fill {:.0} to {:.0} %; they carry the mass of all of the shape, so \
                 check that it is the body they come from, and the units (m)",
                100.0 * filled,
                100.0 * FILLED[0],
                100.0 * FILLED[1]
            ));
        }
        if let Some(across) = self.across.filter(|a| *a < narrow::NARROW) {
            let e = narrow::expected(across);
            out.push(format!(
                "only {across:.1} spheres fit across the narrowest body; round bars so thin have E {:+.0} %, nu {:.3} ± {:.3} \
                 in place of 0.174, bending {:+.0} % and torsion {:+.0} %: take smaller spheres, ten across or more",
                100.0 * (e.young - 1.0),
                e.poisson,
                e.poisson_spread,
                100.0 * (e.bending - 1.0),
                100.0 * (e.torsion - 1.0)
            ));
        }
        out
    }

    /// Lines for a terminal.
    pub fn text(&self) -> Vec<String> {
        let loose = match self.grains {
            0 => String::new(),
            n => format!(", {n} loose grains"),
        };
        let cut = match self.beyond {
            0 => String::new(),
            n => format!(", {n} cut off beyond the zone's border"),
        };
        let parts = match (self.parts.len(), self.bodies) {
            (1, 1) => "1 part".to_owned(),
            (p, 1) => format!("{p} parts in one body"),
            (p, b) => format!("{p} parts in {b} bodies"),
        };
        let inner = self
            .coordination_interior
            .map_or("-".to_owned(), |z| format!("{z:.3}"));
        let across = self.across.map_or("-".to_owned(), |a| format!("{a:.1}"));
        let mut out = vec![
            format!(
                "{} spheres asked, {} placed, {} dropped ({:.2} % of the volume){cut}{loose}, {parts}",
                self.asked,
                self.placed,
                self.dropped,
                100.0 * self.dropped_share
            ),
            format!(
                "z {:.3} all, {:.3} kept, {inner} inside; void fraction {:.4}, {across} spheres across; mass {:.6e} kg, \
                 {:.6} of density times volume",
                self.coordination_all,
                self.coordination_retained,
                self.void_fraction,
                self.mass,
                self.mass_ratio
            ),
        ];
        if let Some(like) = &self.likeness {
            out.push(format!(
                "in its place {:.4} times as stiff as the body, {:.1} % apart in direction; beams {:.3} times those of the bulk",
                like.stiffness,
                100.0 * like.uneven,
                like.beams
            ));
        }
        if self.notch.bonds > 0 {
            out.push(format!(
                "notches took {} bonds, and {} spheres of {:.3e} kg that hung on no others",
                self.notch.bonds, self.notch.spheres, self.notch.mass
            ));
        }
        if self.parts.len() > 1 {
            for p in self.parts.iter().take(NAMED) {
                let text = format!(
                    "part of {} spheres, {:.6e} kg, in body {}",
                    p.spheres, p.mass, p.body
                );
                out.push(text);
            }
            if self.parts.len() > NAMED {
                out.push(format!("and {} parts more", self.parts.len() - NAMED));
            }
        }
        out
    }
}
