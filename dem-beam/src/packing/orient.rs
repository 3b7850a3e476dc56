//! Orientation of surfaces from files: triangles of a shell are turned alike, outer shells face outwards,
//! cavities inwards.

use super::bonding::Components;
use super::nesting::{Place, place};
use super::surface::Surface;
use crate::error::{Error, Result, finite};
use nalgebra::Vector3;
use std::collections::BTreeMap;

type Edges = BTreeMap<(u32, u32), Vec<(usize, bool)>>;

impl Surface {
    /// Makes a closed surface of triangles that may be turned either way, as in files. Triangles with a
    /// repeated corner are left out. Each connected shell is turned alike: outer shells outwards, shells
    /// inside an odd number of others (cavities) inwards. Shells may touch.
    ///
    /// # Errors
    /// Errors of [`Self::new`]; [`Error::OneSidedSurface`]; [`Error::CrossingBodies`] for shells with points
    /// on both sides of another (64 points of each are tested).
    ///
    /// ```
    /// use dem_beam::Surface;
    /// use nalgebra::Vector3;
    /// let corners = vec![Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()];
    /// // The first triangle is turned against the others.
    /// let tetrahedron = Surface::oriented(corners, vec![[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 3, 2]])?;
    /// assert!((tetrahedron.volume() - 1.0 / 6.0).abs() < 1e-15);
    /// # Ok::<(), dem_beam::Error>(())
    /// ```
    pub fn oriented(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self> {
        for (i, c) in vertices
            .iter()
            .enumerate()
            .flat_map(|(i, v)| v.iter().map(move |c| (i, c)))
        {
            finite("coordinate", "vertex", i, *c)?;
        }
        let has_three_corners = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        let mut triangles: Vec<[u32; 3]> = triangles.into_iter().filter(has_three_corners).collect();
        if let Some(&a) = triangles
            .iter()
            .flatten()
            .find(|&&a| a as usize >= vertices.len())
        {
            return Err(Error::no_vertex(a));
        }
        let edges = edges(&vertices, &triangles)?;
        let shells = turn_alike(&mut triangles, &edges)?;
        turn_outwards(&vertices, &mut triangles, &shells)?;
        Self::new(vertices, triangles)
    }
}

/// Returns the triangles of each connected shell of a closed surface, in the order of their first ones.
pub(crate) fn shells(triangles: &[[u32; 3]]) -> Vec<Vec<[u32; 3]>> {
    let mut owner = BTreeMap::new();
    let mut joined = Vec::new();
    for (i, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            let first = *owner.entry((a.min(b), a.max(b))).or_insert(i as u32);
            if first != i as u32 {
                joined.push([first, i as u32]);
            }
        }
    }
    let components = Components::new(triangles.len(), &joined);
    let mut place = BTreeMap::new();
    let mut out: Vec<Vec<[u32; 3]>> = Vec::new();
    for (i, t) in triangles.iter().enumerate() {
        let k = *place.entry(components.root(i as u32)).or_insert(out.len());
        if k == out.len() {
            out.push(Vec::new());
        }
        out[k].push(*t);
    }
    out
}

/// Returns for every edge its two triangles, each with true if it runs along the edge from the smaller to the
/// larger vertex number.
fn edges(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Result<Edges> {
    let mut edges = Edges::new();
    for (i, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            edges.entry((a.min(b), a.max(b))).or_default().push((i, a < b));
        }
    }
    match edges.iter().find(|(_, uses)| uses.len() != 2) {
        Some((&(a, b), uses)) => Err(Error::OpenSurface {
            ends: [a, b].map(|v| vertices[v as usize].into()),
            count: uses.len(),
        }),
        None => Ok(edges),
    }
}

/// Turns the triangles of each connected shell alike; returns the shells.
fn turn_alike(triangles: &mut [[u32; 3]], edges: &Edges) -> Result<Vec<Vec<usize>>> {
    let mut turned: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut shells = Vec::new();
    for seed in 0..triangles.len() {
        if turned[seed].is_some() {
            continue;
        }
        turned[seed] = Some(false);
        let mut shell = vec![seed];
        let mut next = 0;
        while next < shell.len() {
            let i = shell[next];
            next += 1;
            let t = triangles[i];
            let is_turned = turned[i] == Some(true);
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let key = (a.min(b), a.max(b));
                let Some(&(j, up)) = edges[&key].iter().find(|(j, _)| *j != i) else {
                    continue;
                };
                // Triangles turned alike run along their common edge in opposite directions.
                let turn = is_turned != (up == (a < b));
                match turned[j] {
                    None => {
                        turned[j] = Some(turn);
                        shell.push(j);
                    }
                    Some(other) if other != turn => {
                        let (first, second) = (key.0 as usize, key.1 as usize);
                        return Err(Error::OneSidedSurface { first, second });
                    }
                    Some(_) => {}
                }
            }
        }
        shells.push(shell);
    }
    for (t, _) in triangles
        .iter_mut()
        .zip(&turned)
        .filter(|(_, turn)| **turn == Some(true))
    {
        t.swap(1, 2);
    }
    Ok(shells)
}

fn turn_outwards(vertices: &[Vector3<f64>], triangles: &mut [[u32; 3]], shells: &[Vec<usize>]) -> Result<()> {
    let corners = |t: &[u32; 3]| t.map(|i| vertices[i as usize]);
    for shell in shells {
        let volume = |t: &[u32; 3]| {
            let [a, b, c] = corners(t);
            a.dot(&b.cross(&c))
        };
        // The sum is six times the signed volume of the shell.
        if shell.iter().map(|&i| volume(&triangles[i])).sum::<f64>() < 0.0 {
            shell.iter().for_each(|&i| triangles[i].swap(1, 2));
        }
    }
    // All shells face outwards now, so that winding numbers are 0 or 1.
    let facing: Vec<Vec<_>> = shells
        .iter()
        .map(|s| s.iter().map(|&i| corners(&triangles[i])).collect())
        .collect();
    let mut cavities = Vec::new();
    for s in 0..shells.len() {
        let mut shells_around = 0;
        for o in (0..shells.len()).filter(|&o| o != s) {
            match place(&facing[s], &facing[o]) {
                Place::Outside => {}
                Place::Inside => shells_around += 1,
                Place::Crossing(x) => {
                    return Err(Error::CrossingBodies {
                        first: s.min(o) + 1,
                        second: s.max(o) + 1,
                        point: x.into(),
                    });
                }
            }
        }
        if shells_around % 2 == 1 {
            cavities.push(s);
        }
    }
    for s in cavities {
        shells[s].iter().for_each(|&i| triangles[i].swap(1, 2));
    }
    Ok(())
}
