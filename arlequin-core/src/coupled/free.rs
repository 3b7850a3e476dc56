//! Rigid motions that no support holds.

use super::Coupled;
use crate::Real;
use crate::model::DofLayout;
use nalgebra::{Point3, SMatrix, SymmetricEigen, Vector3, Vector6};
use std::fmt::Write as _;

/// Largest resistance of the supports to a unit motion that counts as free, relative to their resistance to
/// all six.
const FREE: f64 = 1e-9;

impl<T: Real> Coupled<T> {
    /// Describes the free rigid motions in words: `'left' and 'right' can move along y and turn about x`.
    /// Empty if none is free.
    pub(super) fn free_motions(&self) -> String {
        let mut out = String::new();
        for group in self.tied_groups() {
            let Some(motions) = self.describe_free(&group) else {
                continue;
            };
            let names: Vec<String> = group
                .iter()
                .map(|k| format!("'{}'", self.subdomains[*k].model().name()))
                .collect();
            let joint = if out.is_empty() { "" } else { "; " };
            let _ = write!(out, "{joint}{} can {motions}", names.join(" and "));
        }
        out
    }

    /// Returns the groups of subdomains that interfaces tie to each other.
    fn tied_groups(&self) -> Vec<Vec<usize>> {
        let mut set: Vec<usize> = (0..self.subdomains.len()).collect();
        for [a, b] in self
            .interfaces
            .iter()
            .map(|i| i.sides.map(|k| set[k]))
            .collect::<Vec<_>>()
        {
            let [low, high] = [a.min(b), a.max(b)];
            set.iter_mut().filter(|s| **s == high).for_each(|s| *s = low);
        }
        let group = |k: usize| (0..set.len()).filter(|m| set[*m] == k).collect::<Vec<_>>();
        (0..set.len()).map(group).filter(|g| !g.is_empty()).collect()
    }

    /// Describes the free motions of a group in words; turns are about the middle of the supported nodes.
    /// `None` if no motion is free.
    fn describe_free(&self, group: &[usize]) -> Option<String> {
        let held = || {
            group.iter().flat_map(|k| {
                let s = &self.subdomains[*k];
                let layout = s.model().layout();
                let dofs = s.supports().iter().flat_map(|m| &m.dofs);
                dofs.map(move |&d| (s.model().nodes()[layout.node_of(d)], d, layout))
            })
        };
        let wide = |x: &Point3<T>| Vector3::new(x.x.as_f64(), x.y.as_f64(), x.z.as_f64());
        let points = group
            .iter()
            .flat_map(|k| self.subdomains[*k].model().nodes())
            .map(wide);
        let (low, high) = points.fold(
            (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)),
            |(l, h), x| (l.inf(&x), h.sup(&x)),
        );
        let size = (high - low).norm().max(f64::MIN_POSITIVE);
        let count = held().count();
        let sum = held().fold(Vector3::zeros(), |s, (x, ..)| s + wide(&x));
        let middle = if count > 0 {
            sum / count as f64
        } else {
            (low + high) / 2.0
        };
        // A motion is free if no prescribed unknown sees it: a null vector of this matrix.
        let mut seen = SMatrix::<f64, 6, 6>::zeros();
        for (x, d, layout) in held() {
            let row = seen_by(d, layout, &((wide(&x) - middle) / size));
            seen += row * row.transpose();
        }
        // Models on a line move in one direction only: the five other motions count as held.
        let lines = group
            .iter()
            .all(|k| self.subdomains[*k].model().layout().components == 1);
        let known = if lines { 1 } else { 6 };
        (known..6).for_each(|k| seen[(k, k)] += 1.0);
        // Arms are relative to the size of the body, so that translations and turns compare.
        let limit = FREE * seen.trace().max(f64::MIN_POSITIVE);
        let free = SymmetricEigen::new(seen)
            .eigenvalues
            .iter()
            .filter(|e| **e <= limit)
            .count();
        let named: Vec<usize> = (0..6).filter(|k| seen[(*k, *k)] <= limit).collect();
        (free > 0).then(|| in_words(&named, free))
    }
}

/// Returns the displacement of a prescribed unknown in each of the six unit motions (three translations,
/// three turns about the middle); `arm` points from the middle to its node.
fn seen_by(dof: usize, layout: DofLayout, arm: &Vector3<f64>) -> Vector6<f64> {
    let mut row = Vector6::zeros();
    if dof < layout.translations() {
        let c = dof % layout.components;
        row[c] = 1.0;
        // (w × r)_c = w · (r × e_c).
        row.fixed_rows_mut::<3>(3)
            .copy_from(&arm.cross(&Vector3::ith(c, 1.0)));
    } else {
        row[3 + (dof - layout.translations()) % 3] = 1.0;
    }
    row
}

/// Puts into words the motions that are free on their own, and the number of other free motions, which
/// combine several.
fn in_words(named: &[usize], free: usize) -> String {
    let list = |from: usize| {
        let in_range = named.iter().filter(|k| (from..from + 3).contains(*k));
        in_range
            .map(|k| ["x", "y", "z"][k - from])
            .collect::<Vec<_>>()
            .join(" and ")
    };
    let mut words = Vec::new();
    for (verb, list) in [("move along", list(0)), ("turn about", list(3))] {
        if !list.is_empty() {
            words.push(format!("{verb} {list}"));
        }
    }
    if free > named.len() {
        words.push(format!(
            "move and turn at once in {} more ways",
            free - named.len()
        ));
    }
    words.join(" and ")
}
