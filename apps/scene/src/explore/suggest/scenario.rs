//! Reads from a scene the quantities that decide accuracy and cost of its coupling.

use super::around::{self, Around};
use super::mesher::{Frame, Mesher};
use super::path::{self, Origin};
use crate::error::{Result, key};
use crate::setup::{self, BodyShape, LoweredInterface, LoweredModel, LoweredScene, OverlapSource};
use crate::spec::{JunctionKind, Load, OverlapShape, ProfileKind, Shape, StepChoice, TimeShape, Wave};
use arlequin::dem_beam::packing::size::mean_diameter;
use std::f64::consts::PI;

/// Number of samples of a signal for its spectrum.
const SAMPLES: usize = 1024;

/// Kind of an overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapKind {
    /// A layer normal to x, y or z.
    Slab,
    /// The space between two regions.
    Shell,
    /// The layer of the body's elements around a zone.
    Zone,
}

/// A scene with one interface, reduced to lengths along the normal of its overlap.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Names of the interface, of the coarse and of the fine model.
    pub names: [String; 3],
    /// Keys of the coarse model and of the interface in the file.
    pub keys: [String; 2],
    /// Kind of the overlap.
    pub kind: OverlapKind,
    /// Sizes around an overlap that is no slab; `None` until the models are built.
    pub around: Option<Around>,
    /// Axis of a slab.
    pub axis: usize,
    /// End of the fine model's own region \[m\].
    pub border: f64,
    /// Direction from the border into the coarse model, ±1.
    pub inward: f64,
    /// Width of the overlap \[m\].
    pub overlap: f64,
    /// True if the scene determines the width of the overlap by numbers that may change.
    pub movable: bool,
    /// Smallest width of the overlap that keeps the fine model at its probes \[m\].
    pub needed: f64,
    /// Lengths of the coarse body and of the fine model's own region along the normal \[m\]; zero until the
    /// models are built if the overlap is no slab.
    pub lengths: [f64; 2],
    /// Lengths of the elements of the coarse model, of the fine model and of the mediator \[m\].
    pub spacings: [f64; 3],
    /// Mean edge of the coarse elements over that of the boxes they are made of; 1 until the models are
    /// built.
    pub stretch: f64,
    /// Division of the coarse body into elements.
    pub(super) mesher: Mesher,
    /// Mediator of a shell of boxes.
    pub(super) frame: Option<Frame>,
    /// Longest distance between nodes \[m\] for which a zone halves the body's elements.
    pub halved_to: Option<f64>,
    /// Smallest size across the axis \[m\], or smallest size of a body with a shell or a zone; `None` for
    /// lines.
    pub across: Option<f64>,
    /// Profile of the weights.
    pub profile: ProfileKind,
    /// Junction.
    pub junction: JunctionKind,
    /// Junction length over mediator spacing.
    pub length_ratio: f64,
    /// True if the scene has an absorber.
    pub absorber: bool,
    /// Probes along the axis: kind (0 displacement, 1 velocity) and distance from the fine border \[m\].
    pub probes: Vec<(usize, f64)>,
    /// Share of element-wise strains in the forces of the coarse and of the fine lattice: 1 except for
    /// natural elements.
    pub elementwise: [f64; 2],
    /// True if the fine model is a random packing.
    pub particles: bool,
    /// Speed of long axial waves \[m/s\], or of shear waves if the overlap is no slab.
    pub speed: f64,
    /// End of the run \[s\], if the scene gives it.
    pub end: Option<f64>,
    /// Own step over critical step, if the scene gives it.
    pub fraction: Option<f64>,
    /// True if the run chooses the own steps of both models.
    pub free_steps: bool,
}

impl Scenario {
    /// Returns measures of the fine model and of the overlap for a width of the overlap \[m\], in any unit.
    pub(super) fn sizes(&self, overlap: f64) -> [f64; 2] {
        match &self.around {
            Some(around) => around.sizes(overlap),
            None => [self.lengths[1] + overlap, overlap],
        }
    }

    /// Returns the table of the coarse model in the file.
    pub(super) fn coarse_table<'a>(&self, scene: &'a LoweredScene) -> Option<&'a LoweredModel> {
        match self.kind {
            OverlapKind::Zone => scene.body.as_ref(),
            _ => scene.model.get(&self.names[1]),
        }
    }
}

/// Reduces a scene to lengths along the normal of its overlap.
pub(super) fn scenario(scene: &LoweredScene) -> Result<Scenario> {
    let mut interfaces = scene.interface.iter();
    let (Some((name, table)), None) = (interfaces.next(), interfaces.next()) else {
        let place = if scene.zone.is_empty() {
            "interface"
        } else {
            "zone"
        };
        let rule = format!(
            "has {} entries; suggest speaks of scenes with one interface or zone between two models",
            scene.interface.len()
        );
        return Err(key(place, rule));
    };
    let model = |role: &str, n: &String| {
        scene.model.get(n).ok_or_else(|| {
            crate::error::unknown(format!("interface.{name}.{role}"), n, "model", scene.model.keys())
        })
    };
    let sides = [model("coarse", &table.coarse)?, model("fine", &table.fine)?];
    match &table.overlap {
        OverlapSource::Given(OverlapShape::Slab { fine, coarse }) => {
            slab(scene, (name, table), sides, [fine, coarse])
        }
        OverlapSource::Given(OverlapShape::Shell { core, domain }) => around::shell(
            scenario_of(scene, (name, table), sides),
            (table, sides),
            [core, domain],
        ),
        OverlapSource::Zone(_) => around::zone(scenario_of(scene, (name, table), sides), scene, sides[1]),
    }
}

/// Returns what does not depend on the form of the overlap; the rest is empty.
fn scenario_of(
    scene: &LoweredScene,
    (name, table): (&str, &LoweredInterface),
    [c, f]: [&LoweredModel; 2],
) -> Scenario {
    Scenario {
        names: [name.to_owned(), table.coarse.clone(), table.fine.clone()],
        keys: [format!("model.{}", table.coarse), format!("interface.{name}")],
        kind: OverlapKind::Slab,
        around: None,
        axis: 0,
        border: 0.0,
        inward: 1.0,
        overlap: 0.0,
        movable: false,
        needed: 0.0,
        lengths: [0.0; 2],
        spacings: [0.0; 3],
        stretch: 1.0,
        mesher: Mesher::of_shape(&c.shape, None),
        frame: None,
        halved_to: None,
        across: None,
        profile: table.weight.kind(),
        junction: table.junction.kind,
        length_ratio: 0.25,
        absorber: table.absorber.is_some(),
        probes: Vec::new(),
        elementwise: [c, f].map(|m| setup::kind(m.kind).element_share(m)),
        particles: setup::kind(f.kind).has_spheres(),
        // A link does not say its material, and its coarse shape is refused below.
        speed: c.material.map_or(0.0, |m| (m.young / m.density).sqrt()),
        end: scene.time.end,
        fraction: match scene.time.step {
            StepChoice::Fraction(x) => Some(x),
            StepChoice::Seconds(_) => None,
        },
        free_steps: matches!(scene.time.step, StepChoice::Fraction(_))
            && scene.time.steps.is_none()
            && c.step.is_none()
            && f.step.is_none(),
    }
}

/// Reads a slab between two planes through the points `fine` and `coarse`.
fn slab(
    scene: &LoweredScene,
    (name, table): (&str, &LoweredInterface),
    [c, f]: [&LoweredModel; 2],
    [fine, coarse]: [&[f64; 3]; 2],
) -> Result<Scenario> {
    let apart: Vec<usize> = (0..3).filter(|&c| (fine[c] - coarse[c]).abs() > 0.0).collect();
    let &[axis] = apart.as_slice() else {
        let rule = "is not normal to x, y or z; suggest needs a slab that is";
        return Err(key(format!("interface.{name}.overlap.slab"), rule));
    };
    let (ce, fe) = (extent(&table.coarse, c, axis)?, extent(&table.fine, f, axis)?);
    let inward = (coarse[axis] - fine[axis]).signum();
    let overlap = (coarse[axis] - fine[axis]).abs();
    let far = |e: [f64; 2], towards: f64| if towards > 0.0 { e[1] } else { e[0] };
    let tolerance = 1e-6 * overlap;
    let meets = (far(fe, inward) - coarse[axis]).abs() < tolerance
        && (far(ce, -inward) - fine[axis]).abs() < tolerance;
    // A count or divisions would change the fine spacing along with the length of the body.
    let movable = meets && table.mediator.shape.is_none() && f.dem.count.is_none() && f.divisions.is_none();
    let mut spacings = spacings(table, c, f, [ce, fe], overlap, axis)?;
    let mesher = Mesher::of_shape(&c.shape, Some(axis));
    if c.divisions.is_none() {
        spacings[0] = mesher.elements(spacings[0]).map_or(spacings[0], |e| e.h);
    }
    let fine_probes = scene
        .probe
        .values()
        .filter(|p| p.model.as_ref() == Some(&table.fine));
    let inside = fine_probes.filter_map(|p| Some((p.at?[axis] - fine[axis]) * inward));
    Ok(Scenario {
        axis,
        border: fine[axis],
        inward,
        overlap,
        movable,
        needed: inside.fold(0.0, f64::max),
        lengths: [ce[1] - ce[0], (fe[1] - fe[0] - overlap).max(0.0)],
        spacings,
        mesher,
        across: across(&c.shape, axis),
        length_ratio: length_ratio(table, spacings[2]),
        probes: path::probes(scene, axis, fine[axis], inward),
        ..scenario_of(scene, (name, table), [c, f])
    })
}

/// Returns the length of a junction over the spacing of the mediator \[m\].
pub(super) fn length_ratio(table: &LoweredInterface, mediator: f64) -> f64 {
    // A quarter of the mediator's spacing is the default of scenes.
    table.junction.length.map_or(0.25, |l| l / mediator)
}

/// Returns the first and last coordinate of a body on an axis \[m\].
pub(super) fn extent(name: &str, model: &LoweredModel, axis: usize) -> Result<[f64; 2]> {
    match model.shape.in_scene() {
        Some(Shape::Box { low, high, .. }) => Ok([low[axis], high[axis]]),
        Some(Shape::Cylinder { from, length, .. }) if axis == 0 => Ok([from[0], from[0] + length]),
        Some(Shape::Bar { from, to, .. }) if axis == 0 => Ok([*from, *to]),
        _ => Err(key(
            format!("model.{name}.shape"),
            format!(
                "suggest cannot read lengths from the shape {}; use box, cylinder or bar",
                model.shape.name()
            ),
        )),
    }
}

fn across(shape: &BodyShape, axis: usize) -> Option<f64> {
    match shape.in_scene()? {
        Shape::Box { low, high, .. } => (0..3)
            .filter(|c| *c != axis)
            .map(|c| high[c] - low[c])
            .reduce(f64::min),
        Shape::Cylinder { radius, .. } => Some(2.0 * radius),
        _ => None,
    }
}

/// Returns the spacings of coarse model, fine model and mediator in the scene \[m\].
fn spacings(
    table: &LoweredInterface,
    c: &LoweredModel,
    f: &LoweredModel,
    extents: [[f64; 2]; 2],
    overlap: f64,
    axis: usize,
) -> Result<[f64; 3]> {
    let spacing_of = |name: &str, m: &LoweredModel, e: [f64; 2]| {
        let divided = m
            .divisions
            .as_ref()
            .and_then(|d| d.get(axis))
            .map(|n| (e[1] - e[0]) / *n as f64);
        // Mean diameter of so many spheres that fill the body at the density of a jammed packing.
        let counted = m.dem.count.and_then(|n| {
            let volume = match m.shape.in_scene()? {
                Shape::Box { low, high, .. } => (0..3).map(|k| high[k] - low[k]).product::<f64>(),
                Shape::Cylinder { length, radius, .. } => PI * radius * radius * length,
                _ => return None,
            };
            Some(mean_diameter(volume, n as f64))
        });
        let spacing = m.spacing.or(divided).or(counted);
        spacing.ok_or_else(|| key(format!("model.{name}"), "suggest needs its spacing [m]; give it"))
    };
    let coarse = spacing_of(&table.coarse, c, extents[0])?;
    let divided = table.mediator.divisions.as_ref().and_then(|d| d.get(axis));
    let mediator = table.mediator.spacing.or(divided.map(|n| overlap / *n as f64));
    Ok([
        coarse,
        spacing_of(&table.fine, f, extents[1])?,
        mediator.unwrap_or(coarse),
    ])
}

/// Amplitudes of the velocity signal at equidistant frequencies.
#[derive(Debug, Clone)]
pub(super) struct Spectrum {
    /// Angular frequencies \[rad/s\].
    pub omega: Vec<f64>,
    /// Amplitudes of the velocity, any unit.
    pub velocity: Vec<f64>,
    /// Source of the signal in words.
    pub source: String,
    /// Place at which the signal starts; `None` if it is not one place, or if the signal lasts.
    pub origin: Option<Origin>,
    /// Duration of the signal \[s\].
    duration: f64,
    /// `∫u² dt` and `∫v² dt` from the start of the signal up to each of a number of equidistant times.
    energies: Vec<[f64; 2]>,
    /// Square of the displacement that remains after the signal.
    left: f64,
}

impl Spectrum {
    /// Returns `∫u² dt` and `∫v² dt` over the first `time` \[s\] of the signal at a place.
    pub(super) fn energies(&self, time: f64) -> [f64; 2] {
        let share = (time / self.duration).max(0.0);
        let last = self.energies.len() - 1;
        let k = ((share * last as f64) as usize).min(last);
        let [u, v] = self.energies[k];
        [u + (share - 1.0).max(0.0) * self.duration * self.left, v]
    }
}

/// Shape of a signal, before its spectrum is computed.
pub(super) struct Source {
    duration: f64,
    text: String,
    signal: Signal,
    origin: Option<Origin>,
}

/// Returns the spectrum of the signal in a run until `end` \[s\].
pub(super) fn spectrum(
    scene: &LoweredScene,
    s: &Scenario,
    end: f64,
    frequency: Option<f64>,
) -> Result<Spectrum> {
    let source = signal(scene, s, frequency)?;
    let mut spectrum = transform(&*source.signal, source.duration, end, source.text);
    spectrum.origin = source.origin;
    Ok(spectrum)
}

/// Returns the signal: a pulse of length 2/`frequency` if a frequency \[Hz\] is given, else the shortest
/// pulse, ramp or wave of the scene.
pub(super) fn signal(scene: &LoweredScene, s: &Scenario, frequency: Option<f64>) -> Result<Source> {
    let pulse = |t: f64| (PI * t).sin().powi(2);
    let mut shortest: Option<Source> = None;
    let mut offer = |duration: f64, text: String, signal: Signal, origin: Option<Origin>| {
        if shortest.as_ref().is_none_or(|f| duration < f.duration) {
            shortest = Some(Source {
                duration,
                text,
                signal,
                origin,
            });
        }
    };
    if let Some(f) = frequency {
        if !(f > 0.0 && f.is_finite()) {
            return Err(crate::error::value("--frequency", f, "must be positive [Hz]"));
        }
        // The spectrum of a sin² pulse of length 2/f has its first zero at f.
        offer(
            2.0 / f,
            format!("a pulse of {:.3e} s (--frequency {f:e})", 2.0 / f),
            Box::new(pulse),
            None,
        );
    } else {
        for (k, l) in scene.load.iter().enumerate() {
            let name = l.name.clone().unwrap_or_else(|| format!("load-{}", k + 1));
            match l.time {
                TimeShape::Pulse { duration } => {
                    offer(
                        duration,
                        format!("the pulse of load '{name}', {duration:.3e} s"),
                        Box::new(pulse),
                        load_origin(scene, s, l),
                    );
                }
                // The derivative of a ramp is a block of its length: the velocity rises gradually.
                TimeShape::Ramp { duration } => {
                    offer(
                        2.0 * duration,
                        format!("the ramp of load '{name}', {duration:.3e} s"),
                        Box::new(ramp),
                        None,
                    );
                }
                _ => {}
            }
        }
        for w in scene.initial.iter().filter_map(|i| i.wave.as_ref()) {
            let duration = w.width / w.speed.map_or(s.speed, f64::abs).max(f64::MIN_POSITIVE);
            let signal = Box::new(|t: f64| (2.0 * PI * t).sin());
            offer(
                duration,
                format!("the initial wave, {duration:.3e} s long"),
                signal,
                wave_origin(w, s),
            );
        }
    }
    shortest.ok_or_else(|| {
        let rule = "no load has a pulse or ramp and there is no initial wave: steps have no highest frequency; give the \
                    highest one of interest, such as --frequency 2e5";
        key("load", rule)
    })
}

/// Returns the place of a load, from which waves run both ways.
fn load_origin(scene: &LoweredScene, s: &Scenario, l: &Load) -> Option<Origin> {
    if s.kind != OverlapKind::Slab {
        return None;
    }
    let place = (path::place(scene, &l.model, &l.at, s.axis)? - s.border) * s.inward;
    Some(Origin {
        place,
        towards: [true, true],
        ahead: 0.0,
    })
}

/// Returns the place and direction of an initial wave.
fn wave_origin(w: &Wave, s: &Scenario) -> Option<Origin> {
    let along = s.kind == OverlapKind::Slab && w.along.index() == s.axis && w.component.index() == s.axis;
    let forwards = w.speed.is_none_or(|c| c > 0.0) == (s.inward > 0.0);
    along.then_some(Origin {
        place: (w.centre - s.border) * s.inward,
        towards: [forwards, !forwards],
        ahead: 0.5 * w.width,
    })
}

type Signal = Box<dyn Fn(f64) -> f64>;

/// Velocity behind a ramped front over twice the time of the ramp; then it stays constant.
fn ramp(t: f64) -> f64 {
    (2.0 * t).min(1.0) * if t < 0.75 { 1.0 } else { 4.0 * (1.0 - t) }
}

/// Fourier transform of a signal on [0, 1] stretched to `duration`, at frequencies up to 20/`duration`.
fn transform(signal: &dyn Fn(f64) -> f64, duration: f64, end: f64, source: String) -> Spectrum {
    // Two frequencies per inverse duration of the run, but at most 2000 in all.
    let step = (0.5 / end.max(duration)).max(20.0 / duration / 2000.0);
    let count = (20.0 / duration / step).ceil() as usize;
    let values: Vec<f64> = (0..SAMPLES)
        .map(|k| signal((k as f64 + 0.5) / SAMPLES as f64))
        .collect();
    let omega: Vec<f64> = (1..=count).map(|n| 2.0 * PI * n as f64 * step).collect();
    let amplitude = |w: &f64| {
        // Half a sample only turns the phase, which is not used.
        let turn = w * duration / SAMPLES as f64;
        let sum = values.iter().enumerate().fold([0.0; 2], |s, (k, v)| {
            let (sin, cos) = (turn * k as f64).sin_cos();
            [s[0] + v * cos, s[1] + v * sin]
        });
        sum[0].hypot(sum[1])
    };
    let (mut u, mut sums) = (0.0, [0.0; 2]);
    let dt = duration / SAMPLES as f64;
    let mut energies = vec![sums];
    for v in &values {
        u += v * dt;
        sums = [sums[0] + u * u * dt, sums[1] + v * v * dt];
        energies.push(sums);
    }
    Spectrum {
        velocity: omega.iter().map(amplitude).collect(),
        omega,
        source,
        origin: None,
        duration,
        energies,
        left: u * u,
    }
}
