//! Results of packings of particle models, in numbers and in warnings.

use arlequin::dem_beam::packing::{Packing, narrow};
use serde::Serialize;

/// Largest dropped share of the volume of spheres without a warning.
const FEW_DROPPED: f64 = 0.005;
/// Usual range of the share of the volume that generated spheres fill, walls included; files may differ.
const FILLED: [f64; 2] = [0.45, 0.75];
/// Number of parts whose size a warning gives.
const NAMED: usize = 6;

/// A packing, as `check`, `run` and `summary.json` show it.
#[derive(Debug, Clone, Serialize)]
pub struct PackingLine {
    /// Number of spheres asked for.
    pub asked: usize,
    /// Number of spheres placed, or read from a file.
    pub placed: usize,
    /// Placed spheres that were cut off beyond the border of a zone.
    pub beyond: usize,
    /// Placed spheres that were left out because no bonds join them to a part.
    pub dropped: usize,
    /// Share of the dropped spheres in the volume of all placed; the other spheres of the body carry their
    /// mass.
    pub dropped_share: f64,
    /// Number of spheres that no bonds join to a part and that stay as loose grains.
    pub grains: usize,
    /// Number of bodies of the shape.
    pub bodies: usize,
    /// Connected parts.
    pub parts: Vec<PartLine>,
    /// Coordination: bonds per sphere times two, over all placed spheres.
    pub coordination_all: f64,
    /// Coordination of the spheres that stayed.
    pub coordination_retained: f64,
    /// Coordination of the spheres farther than two mean diameters from a wall, if any.
    pub coordination_interior: Option<f64>,
    /// Share of the shape that no sphere fills.
    pub void_fraction: f64,
    /// Mean sphere diameters across the narrowest body.
    pub across: Option<f64>,
    /// Bonds and spheres that notches removed.
    pub notch: NotchLine,
    /// Mass of all spheres \[kg\].
    pub mass: f64,
    /// Mass of all spheres over density times volume of the shape.
    pub mass_ratio: f64,
    /// Stiffness of a zone's packing compared with the body's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub likeness: Option<Likeness>,
    /// Fracture energy and the strength that follows from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub toughness: Option<Toughness>,
}

/// Fracture energy of a packing and the strength that follows from it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Toughness {
    /// Fracture energy of the body \[J/m²\].
    pub gc: f64,
    /// Mean diameter of the spheres \[m\].
    pub diameter: f64,
    /// Strength in tension of a plain body \[Pa\]; not known for beams that soften.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tensile_strength: Option<f64>,
    /// Beams that soften.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub softening: Option<Softening>,
}

/// Figures that a fracture energy and a peak stress imply for beams that soften.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Softening {
    /// Axial stress of the beams at their peak \[Pa\].
    pub peak: f64,
    /// Mean diameter \[m\] that spheres must stay below.
    pub largest: f64,
    /// Number of bonds that are stronger than beams that soften can be, and break at once.
    pub snapping: usize,
}

/// Stiffness of a packing in its place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Likeness {
    /// Stiffness over that of the body's elements there, with the beams that the packing has.
    pub stiffness: f64,
    /// Relative deviation from the stiffness of the elements after scaling by that factor: anisotropy, or
    /// another Poisson's ratio.
    pub uneven: f64,
    /// Young's modulus of the beams as fitted to the body, over the one that the scene gives or that bulk
    /// properties imply.
    pub beams: f64,
    /// Number of spheres across an open border: `√|∫ n dA|` over the mean diameter. `None` if the border is
    /// closed or supports hold the zone in every direction.
    pub across: Option<f64>,
}

impl Toughness {
    fn text(&self) -> String {
        let size = format!("gc = {:e} J/m2 with spheres of {:.3e} m", self.gc, self.diameter);
        let strength = self
            .tensile_strength
            .map(|strength| format!(" gives a plain body a strength in tension of about {strength:.1e} Pa"));
        let softening = self.softening.map(|s| {
            let Softening { peak, largest, .. } = s;
            format!(" lets beams soften from {peak:e} Pa on, as with any below {largest:.3e} m")
        });
        [Some(size), strength, softening].into_iter().flatten().collect()
    }

    /// Warning about bonds that do not soften.
    pub(super) fn warning(&self) -> Option<String> {
        let n = self.softening.map(|s| s.snapping).filter(|n| *n > 0)?;
        Some(format!(
            "by their scatter {n} bonds are so strong that they cannot soften: they break at once and release more than gc; take less \
             scatter, smaller spheres or a lower strength"
        ))
    }
}

/// A connected part of a packing.
#[derive(Debug, Clone, Serialize)]
pub struct PartLine {
    /// Number of its body in the shape, from 1.
    pub body: usize,
    /// Number of spheres.
    pub spheres: usize,
    /// Mass \[kg\].
    pub mass: f64,
}

/// Bonds and spheres that notches removed.
#[derive(Debug, Clone, Serialize)]
pub struct NotchLine {
    /// Number of bonds.
    pub bonds: usize,
    /// Spheres removed because they had no bond to a part left.
    pub spheres: usize,
    /// Mass of these spheres \[kg\].
    pub mass: f64,
}

impl PackingLine {
    /// Describes a finished packing of a material with this density \[kg/m³\].
    pub fn from_packing(packing: &Packing, density: f64, likeness: Option<Likeness>) -> Self {
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
            toughness: None,
        }
    }

    /// Warnings about the packing.
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
            // Largest first: only the first few are named.
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
                "only {across:.1} spheres fit across the body, and a thin packing is not as stiff as the bulk (a round \
                 bar of as many: E {:+.0} %, nu {:.3} ± {:.3} in place of 0.174, bending {:+.0} % and torsion {:+.0} %); take \
                 smaller spheres, ten across or more",
                100.0 * (e.young - 1.0),
                e.poisson,
                e.poisson_spread,
                100.0 * (e.bending - 1.0),
                100.0 * (e.torsion - 1.0)
            ));
        }
        out
    }

    /// Description in lines for a terminal.
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
        out.extend(self.toughness.as_ref().map(Toughness::text));
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
