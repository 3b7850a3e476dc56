//! A blunt ball on silica: load and place of the ring and angle of the cone for several radii of the ball,
//! with bonds or particles that break.

use super::check::{Accept, Check};
use super::edge::power;
use super::{Figure, Report, Runs, measured};
use crate::crack::{Broken, Plate, Rising, events};
use arlequin::dem_beam::fracture::Break;
use arlequin_scene::{Result, Scene, Silent, Source};
use std::f64::consts::FRAC_PI_2;

const TEXT: &str = include_str!("../../scenes/blunt-ball.toml");
/// Radii of the ball \[m\].
const RADII: [f64; 3] = [24e-3, 36e-3, 48e-3];
/// Radius of the contact at the end of the run by Hertz's theory \[m\], and duration of the run \[s\].
const CONTACT: f64 = 2e-3;
const DURATION: f64 = 50e-6;
const DIAMETER: f64 = 0.3e-3;
const GC: f64 = 8.0;
/// Depth over which a break belongs to the ring, and depth over which the cone is measured \[m\].
const DEPTHS: [f64; 2] = [0.6e-3, 2.4e-3];
/// A ring breaks in five of the six sectors of the quarter.
const SECTORS: [usize; 2] = [6, 5];
/// Breaks of a ring per mean diameter of its length.
const DENSITY: f64 = 2.0;
/// Distance of a ring from the axis, at least, over the radius of the contact.
const BESIDE: f64 = 1.1;
const SEEDS: [u64; 3] = [1, 2, 3];
/// Criteria: name in the table, key of the scene.
const CRITERIA: [(&str, &str); 2] = [
    ("particles", "{ criterion = \"hydrostatic\", strength = 15e6 }"),
    ("bonds", "{ gc = 8.0 }"),
];

/// A crack under a ball.
#[derive(Debug, Clone)]
pub struct Cone {
    /// Load at which a ring has formed \[N\]; NaN without a ring.
    pub load: f64,
    /// Radius of the ring over that of the contact by Hertz's theory.
    pub ring: f64,
    /// Angle of the cone to the surface \[rad\].
    pub angle: f64,
    /// Share of the breaks of the run that lie under the contact of their time.
    pub under: f64,
    /// Energy released per area of the cone \[J/m²\].
    pub released: f64,
    /// Distance from the axis and height of each break \[m\].
    pub places: [Vec<f64>; 2],
}

/// Distance of a break from the axis \[m\].
fn axis(b: &Break) -> f64 {
    b.place.x.hypot(b.place.y)
}

/// Returns the time at which a ring has formed beside the contact of radius `contact(time)` \[s\], and its
/// radius, the median of its breaks \[m\]. It forms at once: half or one and a half of the number of breaks
/// lead to the same time.
fn first_ring(breaks: &[Break], contact: &dyn Fn(f64) -> f64) -> Option<[f64; 2]> {
    let mut sectors = [false; SECTORS[0]];
    let mut places: Vec<f64> = Vec::new();
    for b in breaks {
        let place = axis(b);
        if b.place.z < -DEPTHS[0] || place < BESIDE * contact(b.time) {
            continue;
        }
        places.insert(places.partition_point(|p| *p < place), place);
        let k = b.place.y.atan2(b.place.x) / FRAC_PI_2 * SECTORS[0] as f64;
        if let Some(sector) = sectors.get_mut(k as usize) {
            *sector = true;
        }
        let median = places[places.len() / 2];
        let long_enough = places.len() as f64 >= DENSITY * FRAC_PI_2 * median / DIAMETER;
        if long_enough && sectors.iter().filter(|s| **s).count() >= SECTORS[1] {
            return Some([b.time, median]);
        }
    }
    None
}

/// Returns the crack under a ball of this radius \[m\].
///
/// # Errors
/// Values that the scene cannot take.
pub fn press(seed: u64, radius: f64, fracture: &str) -> Result<Cone> {
    let depth = CONTACT * CONTACT / radius;
    let scene = Scene::from_source(Source::new("blunt-ball.toml", TEXT))?
        .set("model.block.dem.seed", seed)?
        .set("effect.0.fracture", fracture)?
        .set(
            "effect.2.obstacle.shape.sphere",
            format!("{{ centre = [0.0, 0.0, {radius:e}], radius = {radius:e} }}"),
        )?
        .set(
            "effect.2.obstacle.displacement.amplitude",
            format!("[0.0, 0.0, {:e}]", -depth),
        )?;
    let results = scene.prepare()?.run(&mut Silent)?;
    let breaks = events(&results);
    let contact = |time: f64| CONTACT * (time / DURATION).sqrt();
    let [time, ring] = first_ring(&breaks, &contact).unwrap_or([f64::NAN; 2]);
    let (times, forces) = (&results.recorded.probes.times, measured(&results, "load")?);
    let k = times.partition_point(|t| *t < time);
    // Four quarters.
    let load = forces.get(k).map_or(f64::NAN, |f| 4.0 * f.abs());
    let load = if time.is_finite() { load } else { f64::NAN };
    let plate = Plate {
        ends: [0.0, DEPTHS[1]],
        thickness: FRAC_PI_2 * ring,
        diameter: DIAMETER,
    };
    let outside = breaks.iter().map(|b| Broken {
        time: b.time,
        place: [axis(b), -b.place.z],
        released: b.released,
    });
    let cone = Rising::new(plate, ring, &outside.collect::<Vec<_>>());
    let under = breaks.iter().filter(|b| axis(b) < contact(b.time)).count();
    Ok(Cone {
        load,
        ring: ring / contact(time),
        angle: cone.angle(),
        under: under as f64 / breaks.len().max(1) as f64,
        released: cone.released_per_area(),
        places: [
            breaks.iter().map(axis).collect(),
            breaks.iter().map(|b| b.place.z).collect(),
        ],
    })
}

/// Compares the load of the ring with Auerbach's law and says what the cone is like.
pub(super) fn cone(done: &Runs) -> Result<Report> {
    let seeds = if done.quick { &SEEDS[..1] } else { &SEEDS[..] };
    let radii = if done.quick {
        &[24e-3, 48e-3][..]
    } else {
        &RADII[..]
    };
    let (mut checks, mut curves) = (Vec::new(), Vec::new());
    for (name, key) in CRITERIA {
        let mut powers = Vec::new();
        let mut cones = Vec::new();
        for seed in seeds {
            let series = radii.iter().map(|r| press(*seed, *r, key));
            let series = series.collect::<Result<Vec<_>>>()?;
            let loads: Vec<f64> = series.iter().map(|c| c.load).collect();
            powers.push(power(radii, &loads));
            cones.extend(series);
        }
        let count = cones.len() as f64;
        let rings = cones.iter().filter(|c| c.load.is_finite()).count() as f64;
        // A run without a ring has neither radius nor angle; the first row counts it.
        let over = |f: &dyn Fn(&Cone) -> f64| {
            let values = cones.iter().map(f).filter(|x| x.is_finite());
            values.collect::<Vec<f64>>()
        };
        let row = |what: &str, values: &[f64], accept: Accept| {
            Check::over_seeds(&format!("{name}: {what}"), values, accept)
        };
        checks.push(Check::against(
            format!("{name}: runs with a ring"),
            rings,
            count,
            "our expectation",
            Accept::Absolute(0.0),
        ));
        checks.push(
            row(
                "power of the load over the radius",
                &powers,
                Accept::Absolute(0.2),
            )
            .beside(1.0, "Auerbach"),
        );
        checks.push(row(
            "radius of the ring over the contact's",
            &over(&|c| c.ring),
            Accept::Between(1.0, 2.0),
        ));
        checks.push(row(
            "angle of the cone to the surface [deg]",
            &over(&|c| c.angle.to_degrees()),
            Accept::Between(15.0, 45.0),
        ));
        checks.push(row(
            "share of breaks under the contact",
            &over(&|c| c.under),
            Accept::AtMost(0.2),
        ));
        if name == "bonds" {
            checks.push(row(
                "released energy per area over gc",
                &over(&|c| c.released / GC),
                Accept::Between(0.88, 1.12),
            ));
        }
        if let Some(first) = cones.last() {
            let [across, height] = &first.places;
            let scaled = |v: &[f64]| v.iter().map(|x| 1e3 * x).collect::<Vec<f64>>();
            curves.push((format!("{name} break"), scaled(across), scaled(height)));
        }
    }
    let figure = Figure {
        file: "cone",
        title: "Broken bonds under a ball of 48 mm, one packing",
        axes: [["distance from the axis", "mm"], ["z", "mm"]],
        log: [false; 2],
        curves,
        says: String::new(),
    };
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}
