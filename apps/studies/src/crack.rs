//! The path of a crack through a plate, measured from its breaks: branches, speed, released energy.

use arlequin::dem_beam::fracture::{Break, locked};
use arlequin_scene::Results;

/// Distance of two breaks across the crack beyond which they belong to different branches, in spheres.
const GAP: f64 = 3.0;
/// Breaks in a slice of one branch that the crack has passed through, over the number expected: less is
/// scattered damage.
const PASSED: f64 = 0.3;
/// Length over which a second branch must go on to be one \[spheres\]; shorter ones are attempts.
const GOES_ON: f64 = 16.0;
/// Share of the slices after a fork that must have both branches.
const BOTH: f64 = 0.8;
/// Distance from the crack up to which breaks belong to it, in spheres.
const BESIDE: f64 = 2.5;
/// Length over which a speed is measured \[spheres\].
const RUN: f64 = 20.0;

/// Breaks of all models of a run.
#[must_use]
pub fn events(results: &Results) -> Vec<Break> {
    let logs = results.breaks.iter().flatten();
    logs.flat_map(|log| locked(log).events().to_vec()).collect()
}

/// Broken bonds of a run, placed by their x and y.
#[must_use]
pub fn broken(results: &Results) -> Vec<Broken> {
    let place = |e: Break| Broken {
        time: e.time,
        place: [e.place.x, e.place.y],
        released: e.released,
    };
    events(results).into_iter().map(place).collect()
}

/// A bond that broke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Broken {
    /// Time \[s\].
    pub time: f64,
    /// Place along the crack, and across it \[m\].
    pub place: [f64; 2],
    /// Energy that it released \[J\].
    pub released: f64,
}

/// A plate with a crack along its first coordinate.
#[derive(Debug, Clone, Copy)]
pub struct Plate {
    /// Place of the tip of the notch, and end of the plate \[m\].
    pub ends: [f64; 2],
    /// Thickness \[m\].
    pub thickness: f64,
    /// Mean diameter of the spheres \[m\].
    pub diameter: f64,
}

/// A part of the plate two spheres long.
#[derive(Debug, Clone, Default)]
struct Slice {
    /// Time at which the crack passed \[s\]; `None` if it did not.
    passed: Option<f64>,
    /// Place of each branch across the crack \[m\], ascending.
    branches: Vec<f64>,
}

/// A fork of a crack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fork {
    /// Place along the crack \[m\].
    pub place: f64,
    /// Time \[s\].
    pub time: f64,
}

/// A measured crack.
#[derive(Debug, Clone)]
pub struct CrackPath {
    plate: Plate,
    slices: Vec<Slice>,
    released: f64,
}

impl CrackPath {
    /// Sorts breaks into slices and branches.
    #[must_use]
    pub fn new(plate: Plate, breaks: &[Broken]) -> Self {
        let width = 2.0 * plate.diameter;
        let count = ((plate.ends[1] - plate.ends[0]) / width).floor().max(0.0) as usize;
        let mut parts: Vec<Vec<&Broken>> = vec![Vec::new(); count];
        for b in breaks {
            let k = (b.place[0] - plate.ends[0]) / width;
            if let Some(part) = parts.get_mut(k as usize).filter(|_| k >= 0.0) {
                part.push(b);
            }
        }
        // A section takes about one bond per square of a diameter.
        let least = PASSED * width * plate.thickness / plate.diameter.powi(2);
        let slices = parts
            .into_iter()
            .map(|part| Slice::new(part, plate.diameter, least.max(2.0)));
        Self {
            plate,
            slices: slices.collect(),
            released: breaks.iter().map(|b| b.released).sum(),
        }
    }

    fn width(&self) -> f64 {
        2.0 * self.plate.diameter
    }

    /// Middle of slice `k` \[m\].
    fn middle(&self, k: usize) -> f64 {
        self.plate.ends[0] + (k as f64 + 0.5) * self.width()
    }

    /// Number of slices that the crack passed, from the notch to its furthest tip.
    fn reach(&self) -> usize {
        self.slices
            .iter()
            .rposition(|s| s.passed.is_some())
            .map_or(0, |k| k + 1)
    }

    /// Length of the crack along the plate \[m\].
    #[must_use]
    pub fn length(&self) -> f64 {
        self.reach() as f64 * self.width()
    }

    /// Returns where and when the crack divides for good: from there to its tips, it has two branches or more
    /// in most slices. Branches that stop are no fork.
    #[must_use]
    pub fn fork(&self) -> Option<Fork> {
        let (end, least) = (self.reach(), (GOES_ON / 2.0) as usize);
        let both = |k: usize| self.slices[k].branches.len() >= 2;
        let goes_on = |k: usize| (k..end).filter(|j| both(*j)).count() as f64 >= BOTH * (end - k) as f64;
        let first = (0..end).find(|&k| end - k >= least && both(k) && both(k + 1) && goes_on(k))?;
        Some(Fork {
            place: self.middle(first),
            time: self.slices[first].passed.unwrap_or_default(),
        })
    }

    /// Time at which the crack left the notch \[s\]; infinite if it did not.
    #[must_use]
    pub fn start(&self) -> f64 {
        self.slices
            .iter()
            .filter_map(|s| s.passed)
            .fold(f64::INFINITY, f64::min)
    }

    /// Returns the largest and the mean speed of the tip before a place \[m/s\]; zero for a crack that is too
    /// short.
    #[must_use]
    pub fn speeds(&self, before: f64) -> [f64; 2] {
        let rows: Vec<[f64; 2]> = (0..self.reach())
            .filter(|k| self.middle(*k) <= before)
            .filter_map(|k| self.slices[k].passed.map(|t| [t, self.middle(k)]))
            .collect();
        let window = (RUN / 2.0) as usize;
        let largest = rows.windows(window).map(slope).fold(0.0, f64::max);
        let mean = if rows.len() < window { 0.0 } else { slope(&rows) };
        [largest, mean]
    }

    /// Largest distance of the crack from the line `across` \[m\].
    #[must_use]
    pub fn wander(&self, across: f64) -> f64 {
        let places = self.slices.iter().flat_map(|s| &s.branches);
        places.fold(0.0, |w, y| w.max((y - across).abs()))
    }

    /// Energy released per area of the branches \[J/m²\].
    #[must_use]
    pub fn released_per_area(&self) -> f64 {
        let mut length = 0.0;
        let mut before: &[f64] = &[];
        for slice in self.slices[..self.reach()]
            .iter()
            .filter(|s| !s.branches.is_empty())
        {
            for y in &slice.branches {
                let step = before.iter().map(|b| (y - b).abs()).fold(f64::INFINITY, f64::min);
                // A branch that begins here, or that stopped, does not come from another one.
                let step = if step < 2.0 * self.width() { step } else { 0.0 };
                length += self.width().hypot(step);
            }
            before = &slice.branches;
        }
        self.released / (length * self.plate.thickness)
    }
}

impl Slice {
    fn new(mut part: Vec<&Broken>, diameter: f64, least: f64) -> Self {
        part.sort_by(|a, b| a.place[1].total_cmp(&b.place[1]));
        let branches = part
            .chunk_by(|a, b| b.place[1] - a.place[1] <= GAP * diameter)
            .filter(|c| c.len() as f64 >= least)
            .map(|c| c[c.len() / 2].place[1])
            .collect();
        let mut times: Vec<f64> = part.iter().map(|b| b.time).collect();
        times.sort_by(f64::total_cmp);
        Self {
            passed: times.get(least.ceil() as usize - 1).copied(),
            branches,
        }
    }
}

/// A crack that rises from the tip of a notch, along the second coordinate of its breaks.
#[derive(Debug, Clone)]
pub struct Rising {
    plate: Plate,
    /// Place of the tip along the notch \[m\].
    tip: f64,
    /// Median place along the notch \[m\] and first time \[s\] of each slice that the crack passed.
    passed: Vec<[f64; 2]>,
    released: f64,
}

impl Rising {
    /// Sorts the breaks above the tip into slices of two spheres, up to the first that the crack did not
    /// pass. `plate.ends` lie along the second coordinate; `tip` is the place of the tip along the first
    /// \[m\].
    #[must_use]
    pub fn new(plate: Plate, tip: f64, breaks: &[Broken]) -> Self {
        let width = 2.0 * plate.diameter;
        let least = (PASSED * width * plate.thickness / plate.diameter.powi(2)).max(2.0);
        let (mut passed, mut released) = (Vec::new(), 0.0);
        let mut before = tip;
        for k in 0..((plate.ends[1] - plate.ends[0]) / width).floor().max(0.0) as usize {
            let from = plate.ends[0] + k as f64 * width;
            // Other cracks of the plate lie farther away than a crack can go to the side in a slice.
            let near = |b: &&Broken| {
                (from..from + width).contains(&b.place[1]) && (b.place[0] - before).abs() < 2.0 * width
            };
            let mut part: Vec<&Broken> = breaks.iter().filter(near).collect();
            if (part.len() as f64) < least {
                break;
            }
            part.sort_by(|a, b| a.place[0].total_cmp(&b.place[0]));
            before = part[part.len() / 2].place[0];
            let first = part.iter().map(|b| b.time).fold(f64::INFINITY, f64::min);
            passed.push([before, first]);
            released += part.iter().map(|b| b.released).sum::<f64>();
        }
        Self {
            plate,
            tip,
            passed,
            released,
        }
    }

    fn width(&self) -> f64 {
        2.0 * self.plate.diameter
    }

    /// Height above the tip that the crack reached \[m\].
    #[must_use]
    pub fn rise(&self) -> f64 {
        self.passed.len() as f64 * self.width()
    }

    /// Time of the first break \[s\]; infinite without a crack.
    #[must_use]
    pub fn start(&self) -> f64 {
        self.passed.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min)
    }

    /// Angle to the notch \[rad\], by least squares over the crack.
    #[must_use]
    pub fn angle(&self) -> f64 {
        let rows = self.passed.iter().enumerate();
        let rows: Vec<[f64; 2]> = rows.map(|(k, p)| [k as f64 * self.width(), p[0]]).collect();
        1.0_f64.atan2(slope(&rows))
    }

    /// Energy released per area \[J/m²\].
    #[must_use]
    pub fn released_per_area(&self) -> f64 {
        let (mut length, mut before) = (0.0, self.tip);
        for [place, _] in &self.passed {
            length += self.width().hypot(place - before);
            before = *place;
        }
        self.released / (length * self.plate.thickness)
    }
}

/// Energy of the breaks between two places along the crack, as far as they lie at most 2.5 mean diameters
/// beside the median of the breaks in the same part of about two diameters \[J\]: small branches are left
/// out.
#[must_use]
pub fn released_beside(breaks: &[Broken], [from, to]: [f64; 2], diameter: f64) -> f64 {
    let count = ((to - from) / (2.0 * diameter)).ceil().max(1.0);
    let mut parts: Vec<Vec<&Broken>> = vec![Vec::new(); count as usize];
    for b in breaks.iter().filter(|b| b.place[0] >= from && b.place[0] < to) {
        let k = ((b.place[0] - from) / (to - from) * count) as usize;
        let last = parts.len() - 1;
        parts[k.min(last)].push(b);
    }
    let mut out = 0.0;
    for part in &mut parts {
        part.sort_by(|a, b| a.place[1].total_cmp(&b.place[1]));
        let Some(median) = part.get(part.len() / 2).map(|b| b.place[1]) else {
            continue;
        };
        let near = part
            .iter()
            .filter(|b| (b.place[1] - median).abs() <= BESIDE * diameter);
        out += near.map(|b| b.released).sum::<f64>();
    }
    out
}

/// Slope of the second numbers over the first, by least squares.
pub(crate) fn slope(rows: &[[f64; 2]]) -> f64 {
    let n = rows.len() as f64;
    let mean = rows
        .iter()
        .fold([0.0; 2], |m, r| [m[0] + r[0] / n, m[1] + r[1] / n]);
    let (both, square) = rows.iter().fold((0.0, 0.0), |(b, s), r| {
        let d = r[0] - mean[0];
        (b + d * (r[1] - mean[1]), s + d * d)
    });
    both / square
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLATE: Plate = Plate {
        ends: [50.0, 100.0],
        thickness: 2.0,
        diameter: 0.5,
    };

    /// A crack at speed 2 that divides at `fork` into branches which open by half their length; those above
    /// stop after `stop`.
    fn breaks(fork: f64, stop: f64) -> Vec<Broken> {
        let mut out = Vec::new();
        let steps = 50 * 8;
        for k in 0..steps {
            let x = 50.0 + 50.0 * f64::from(k) / f64::from(steps);
            let apart = 0.5 * (x - fork).max(0.0);
            let both = x < fork + stop;
            for y in [-apart, apart].into_iter().filter(|y| *y <= 0.0 || both) {
                out.push(Broken {
                    time: 1.0 + (x - 50.0) / 2.0,
                    place: [x, y + 0.2 * f64::from(k % 3)],
                    released: 0.25,
                });
            }
        }
        out
    }

    #[test]
    fn a_fork_is_found_where_it_is_and_an_attempt_is_none() {
        let forked = CrackPath::new(PLATE, &breaks(75.0, 99.0));
        let fork = forked.fork().expect("a fork");
        // The branches count as two from three spheres apart on.
        assert!((75.0..80.0).contains(&fork.place), "{fork:?}");
        assert!(
            (fork.time - 1.0 - (fork.place - 50.0) / 2.0).abs() < 0.5,
            "{fork:?}"
        );
        assert_eq!(CrackPath::new(PLATE, &breaks(75.0, 10.0)).fork(), None);
        assert_eq!(CrackPath::new(PLATE, &breaks(999.0, 0.0)).fork(), None);
        assert_eq!(CrackPath::new(PLATE, &[]).fork(), None);
    }

    #[test]
    fn speed_and_released_energy_are_those_of_the_breaks() {
        let straight = CrackPath::new(PLATE, &breaks(999.0, 0.0));
        let [largest, mean] = straight.speeds(f64::INFINITY);
        assert!(
            (mean / 2.0 - 1.0).abs() < 1e-3 && (largest / 2.0 - 1.0).abs() < 0.03,
            "{largest} {mean}"
        );
        assert!((straight.start() - 1.0).abs() < 0.5 && (straight.length() - 50.0).abs() < 1e-9);
        assert!(straight.wander(0.0) < 0.5);
        // 800 breaks (two at the same place) of a quarter each, over 50 by 2.
        let per_area = straight.released_per_area();
        assert!((per_area - 800.0 * 0.25 / 100.0).abs() < 0.02, "{per_area}");
        // The area is that of the crack, which is longer where it runs at an angle.
        let mut sloping = breaks(999.0, 0.0);
        sloping
            .iter_mut()
            .for_each(|b| b.place[1] += 0.5 * (b.place[0] - 50.0));
        let per_area = CrackPath::new(PLATE, &sloping).released_per_area();
        let wanted = 800.0 * 0.25 / (2.0 * 50.0_f64.hypot(25.0));
        assert!((per_area / wanted - 1.0).abs() < 0.02, "{per_area} {wanted}");
        // Sixteen bonds per unit of length, between two places; small branches are left out.
        let beside = released_beside(&breaks(999.0, 0.0), [60.0, 90.0], 0.5);
        assert!((beside - 16.0 * 30.0 * 0.25).abs() < 1.0, "{beside}");
        let mut stray = breaks(999.0, 0.0);
        stray.push(Broken {
            place: [70.0, 2.0],
            ..stray[0]
        });
        assert!((released_beside(&stray, [60.0, 90.0], 0.5) - beside).abs() < 1e-12);
        // The same crack, seen as one that rises at an angle.
        let slanted: Vec<Broken> = breaks(999.0, 0.0)
            .iter()
            .map(|b| Broken {
                place: [0.5 * (b.place[0] - 50.0), b.place[0]],
                ..*b
            })
            .collect();
        let rising = Rising::new(PLATE, 0.0, &slanted);
        assert!((rising.angle() - 2.0_f64.atan()).abs() < 1e-3 && (rising.rise() - 50.0).abs() < 1e-9);
        let wanted = 800.0 * 0.25 / (2.0 * 50.0_f64.hypot(25.0));
        assert!(
            (rising.released_per_area() / wanted - 1.0).abs() < 0.01,
            "{rising:?}"
        );
        assert!((rising.start() - straight.start()).abs() < 0.5);
        // Before the fork alone, the speed is the same.
        let forked = CrackPath::new(PLATE, &breaks(75.0, 99.0));
        assert!((forked.speeds(75.0)[1] / 2.0 - 1.0).abs() < 1e-3);
        assert!(CrackPath::new(PLATE, &breaks(75.0, 99.0)).wander(0.0) > 11.0);
    }
}
