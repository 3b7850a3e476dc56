//! Points of two models that may touch facets of the other one, in a list with a skin.
//!
//! A tree over the boxes of the facets finds those near a point, at a cost of `N log N`. The list holds until
//! both models together have moved by the skin.

use super::between::locate;
use super::exterior::Side;
use super::facet::{Facet, Foot, PlacedFacet, Seeker, foot};
use crate::effect::Instant;
use crate::geometry::bounds_of;
use crate::tree::BoxTree;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Points per unit of parallel work.
const CHUNK: usize = 256;

/// Points within reach of facets.
#[derive(Debug)]
pub(super) struct Near {
    skin: f64,
    /// Listed points in ascending order, those of the second side after all of the first; and where the
    /// places of the facets of each in the list of the other side begin, and end for the last.
    points: Vec<u32>,
    starts: Vec<usize>,
    facets: Vec<u32>,
    /// Listed facets of each side in ascending order, and their present places.
    listed: [Vec<u32>; 2],
    placed: [Vec<PlacedFacet>; 2],
    feet: Vec<Foot>,
    /// Displacements of the nodes of both sides when the list was built.
    built: [Vec<Vector3<f64>>; 2],
    is_built: bool,
    pub(super) searches: usize,
}

impl Near {
    pub(super) fn new(skin: f64) -> Self {
        Self {
            skin,
            points: Vec::new(),
            starts: vec![0],
            facets: Vec::new(),
            listed: [Vec::new(), Vec::new()],
            placed: [Vec::new(), Vec::new()],
            feet: Vec::new(),
            built: [Vec::new(), Vec::new()],
            is_built: false,
            searches: 0,
        }
    }

    /// Longest way of both models in a step together that cannot leap over a facet \[m\].
    pub(super) fn reach(&self) -> f64 {
        self.skin
    }

    /// Number of listed points.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Returns a listed point and its foot.
    pub(super) fn foot(&self, n: usize) -> (u32, Foot) {
        (self.points[n], self.feet[n])
    }

    /// Iterates over listed points and their feet.
    pub(super) fn feet(&self) -> impl Iterator<Item = (u32, &Foot)> {
        self.points.iter().copied().zip(&self.feet)
    }

    /// Returns whether a point is listed.
    pub(super) fn lists(&self, point: u32) -> bool {
        self.points.binary_search(&point).is_ok()
    }

    /// Drops the list; the next instant builds it anew.
    pub(super) fn forget(&mut self) {
        self.is_built = false;
    }

    /// Sum over both sides of the largest displacement of a node in the last step, less that of a node of the
    /// first side \[m\]: bodies may fly together as fast as they like.
    pub(super) fn way(&self, sides: &[Side; 2], instants: [&Instant<'_, f64>; 2]) -> f64 {
        let first = sides[0].nodes.first();
        let common = first.map_or_else(Vector3::zeros, |n| three(instants[0].v_half, *n));
        let fastest = |s: usize| farthest(&sides[s].nodes, |n, _| three(instants[s].v_half, n) - common);
        instants[0].dt * (fastest(0) + fastest(1))
    }

    /// Rebuilds the list if it no longer holds; returns whether it did.
    pub(super) fn refresh(&mut self, sides: &[Side; 2], q: [&[f64]; 2]) -> bool {
        if self.is_built {
            let built = &self.built;
            let moved = |s: usize| farthest(&sides[s].nodes, |n, place| three(q[s], n) - built[s][place]);
            // A margin of a thousandth for round-off.
            if moved(0) + moved(1) <= 0.999 * self.skin {
                return false;
            }
        }
        for (s, built) in self.built.iter_mut().enumerate() {
            built.clear();
            built.extend(sides[s].nodes.iter().map(|n| three(q[s], *n)));
        }
        self.points.clear();
        self.facets.clear();
        self.starts.truncate(1);
        let mut first = 0;
        for s in 0..2 {
            self.list(s, first, sides, q);
            first += sides[s].points.len() as u32;
        }
        self.feet.resize(self.points.len(), Foot::none());
        (self.is_built, self.searches) = (true, self.searches + 1);
        true
    }

    /// Lists the points of side `s` near facets of the other side; its points are numbered from `first`.
    fn list(&mut self, s: usize, first: u32, sides: &[Side; 2], q: [&[f64]; 2]) {
        let (own, other) = (&sides[s], &sides[1 - s]);
        self.listed[1 - s].clear();
        if own.points.is_empty() || other.facets.is_empty() {
            return;
        }
        let around = |f: &Facet| {
            let corners = f.triangle.places(|n| other.position(n, q[1 - s]));
            let [low, high] = bounds_of(corners.map(Point3::from).iter());
            let margin = Vector3::repeat(self.skin + f.depth);
            [low - margin, high + margin]
        };
        // What sleeps is where it fell asleep: it touches nothing.
        let awake = (0..).zip(&other.facets).filter(|(_, f)| other.is_awake(f));
        let (awake, boxes): (Vec<u32>, Vec<_>) = awake.map(|(k, f): (u32, _)| (k, around(f))).unzip();
        let tree = BoxTree::new(boxes);
        let near = |k: usize| {
            if own.weight(&own.points[k].place) <= 0.0 {
                return None;
            }
            let x = Point3::from(own.points[k].position(q[s]));
            let size = Vector3::repeat(own.radius(k));
            let mut facets: Vec<u32> = Vec::new();
            tree.any(&[x - size, x + size], &mut |facet| {
                facets.push(awake[facet]);
                false
            });
            // Ascending: the foot does not depend on the tree.
            facets.sort_unstable();
            (!facets.is_empty()).then_some((first + k as u32, facets))
        };
        let count = 0..own.points.len();
        let lists: Vec<_> = count
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter_map(near)
            .collect();
        let listed = &mut self.listed[1 - s];
        *listed = lists.iter().flat_map(|l| &l.1).copied().collect();
        listed.sort_unstable();
        listed.dedup();
        let mut places = vec![0; other.facets.len()];
        (0..).zip(&*listed).for_each(|(k, f)| places[*f as usize] = k);
        for (point, facets) in lists {
            self.points.push(point);
            self.facets.extend(facets.iter().map(|f| places[*f as usize]));
            self.starts.push(self.facets.len());
        }
    }

    /// Finds the feet of all listed points.
    pub(super) fn measure(&mut self, sides: &[Side; 2], q: [&[f64]; 2]) {
        for (s, placed) in self.placed.iter_mut().enumerate() {
            let side = &sides[s];
            let place = |f: &u32| PlacedFacet::new(&side.facets[*f as usize], |n| side.position(n, q[s]));
            let listed = self.listed[s].par_iter().with_min_len(CHUNK);
            listed.map(place).collect_into_vec(placed);
        }
        let (points, starts, facets, placed) = (&self.points, &self.starts, &self.facets, &self.placed);
        let find = |(n, out): (usize, &mut Foot)| {
            let (s, k) = locate(sides, points[n]);
            let (own, placed) = (&sides[s], &placed[1 - s]);
            let p = &own.points[k];
            let seeker = Seeker {
                at: p.position(q[s]),
                normal: (!own.turns).then_some(p.normal),
                radius: own.radius(k),
            };
            let near = facets[starts[n]..starts[n + 1]].iter();
            *out = foot(&seeker, near.map(|f| &placed[*f as usize]));
        };
        let feet = self.feet.par_iter_mut().enumerate();
        feet.with_min_len(CHUNK).for_each(find);
    }
}

/// Vector of a node in a nodal field.
pub(super) fn three(x: &[f64], n: u32) -> Vector3<f64> {
    let o = 3 * n as usize;
    Vector3::new(x[o], x[o + 1], x[o + 2])
}

/// Largest length of a vector over nodes, which is given by the number of the node and its place in the list.
pub(super) fn farthest(nodes: &[u32], vector: impl Fn(u32, usize) -> Vector3<f64> + Sync) -> f64 {
    let square = |(place, n): (usize, &u32)| vector(*n, place).norm_squared();
    let squares = nodes.par_iter().enumerate().with_min_len(16 * CHUNK).map(square);
    squares.reduce(|| 0.0, f64::max).sqrt()
}
