//! Insertion of one point: find the cavity, build the star, join its tetrahedra.

use super::Delaunay;
use crate::tet::{EdgeTable, FACES, INF, NONE, Tet};
use nalgebra::Point3;

/// Working buffers of the insertion, kept between points.
#[derive(Debug, Clone)]
pub(super) struct Work {
    table: EdgeTable,
    /// For each tetrahedron `2 * stamp + in_cavity` of its last visit.
    mark: Vec<u32>,
    stamp: u32,
    cavity: Vec<u32>,
    border: Vec<Border>,
    free: Vec<u32>,
    created: Vec<u32>,
}

/// Face of the cavity seen from inside, and the tetrahedron behind it.
#[derive(Debug, Clone, Copy)]
struct Border {
    face: [u32; 3],
    behind: u32,
}

/// Result of an insertion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Inserted {
    /// Index of one of the new tetrahedra.
    At(u32),
    /// Index of the vertex that is already at this position.
    Duplicate(u32),
}

impl Work {
    pub(super) fn new(table: EdgeTable) -> Self {
        let empty = Vec::new;
        Self {
            table,
            mark: empty(),
            stamp: 0,
            cavity: empty(),
            border: Vec::new(),
            free: empty(),
            created: empty(),
        }
    }

    pub(super) fn grow_marks(&mut self, tets: usize) {
        if self.mark.len() < tets {
            self.mark.resize(tets, 0);
        }
    }

    /// Clears the buffers that depend on the numbering of the tetrahedra.
    fn reset(&mut self) {
        self.mark.clear();
        self.stamp = 0;
        self.free.clear();
    }

    fn next_stamp(&mut self) -> u32 {
        // Marks hold `2 * stamp + 1`: the stamp must leave one bit free.
        if self.stamp >= (u32::MAX >> 1) - 1 {
            self.mark.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
        self.stamp
    }
}

impl Delaunay {
    /// Adds a point with the highest rank. Returns its index, or the index of the vertex already at this
    /// position.
    pub(crate) fn insert(&mut self, p: Point3<f64>, hint: u32) -> (u32, Inserted) {
        let v = self.points.len() as u32;
        self.points.push(p);
        self.work.table.reserve(self.points.len());
        self.work.grow_marks(self.tets.len());
        let outcome = self.insert_vertex(v, hint);
        match outcome {
            Inserted::Duplicate(kept) => {
                self.points.pop();
                (kept, outcome)
            }
            Inserted::At(_) => {
                self.at_vertex.push(NONE);
                for i in 0..self.work.created.len() {
                    let t = self.work.created[i];
                    for v in self.tets[t as usize].v {
                        if v != INF {
                            self.at_vertex[v as usize] = t;
                        }
                    }
                }
                (v, outcome)
            }
        }
    }

    /// Inserts vertex `v`, starting the walk at `hint`.
    pub(super) fn insert_vertex(&mut self, v: u32, hint: u32) -> Inserted {
        let q = self.points[v as usize];
        // An equal point can only be a corner of the tetrahedron that holds it.
        let start = self.walk(&q, hint);
        for w in self.tets[start as usize].v {
            if w != INF && self.points[w as usize] == q {
                return Inserted::Duplicate(w);
            }
        }
        self.find_cavity(start, &q, self.rank(v));
        self.fill_cavity(v)
    }

    fn find_cavity(&mut self, start: u32, q: &Point3<f64>, rank: u64) {
        let mut work = std::mem::replace(&mut self.work, Work::new(EdgeTable::default()));
        let stamp = work.next_stamp();
        // Marks of earlier points are smaller than `out`: they need not be cleared.
        let (out, inside) = (2 * stamp, 2 * stamp + 1);
        work.cavity.clear();
        work.border.clear();
        work.cavity.push(start);
        work.mark[start as usize] = inside;
        let mut next = 0;
        while next < work.cavity.len() {
            let t = self.tets[work.cavity[next] as usize];
            next += 1;
            for (slot, &n) in t.n.iter().enumerate() {
                let neighbour = n >> 2;
                let mark = &mut work.mark[neighbour as usize];
                if *mark == inside {
                    continue;
                }
                if *mark != out {
                    if self.conflicts(neighbour, q, rank) {
                        *mark = inside;
                        work.cavity.push(neighbour);
                        continue;
                    }
                    *mark = out;
                }
                let [a, b, c] = FACES[slot].map(|k| t.v[k]);
                work.border.push(Border {
                    face: [a, c, b],
                    behind: n,
                });
            }
        }
        self.work = work;
    }

    /// Replaces the cavity by the star of `v`.
    fn fill_cavity(&mut self, v: u32) -> Inserted {
        let mut work = std::mem::replace(&mut self.work, Work::new(EdgeTable::default()));
        // The border holds copies, so the slots of the cavity can be reused at once.
        work.free.append(&mut work.cavity);
        work.created.clear();
        let mut last = 0;
        for i in 0..work.border.len() {
            let Border { face, behind } = work.border[i];
            let id = match work.free.pop() {
                Some(id) => id,
                None => {
                    self.tets.push(Tet {
                        v: [INF; 4],
                        n: [NONE; 4],
                    });
                    work.mark.push(0);
                    self.tets.len() as u32 - 1
                }
            };
            last = id;
            work.created.push(id);
            // Ghosts must have infinity in slot 3, see `Tet::is_ghost`.
            let (corners, apex) = with_infinity_last([face[0], face[1], face[2], v]);
            let mut t = Tet {
                v: corners,
                n: [NONE; 4],
            };
            t.n[apex] = behind;
            self.tets[(behind >> 2) as usize].n[(behind & 3) as usize] = id << 2 | apex as u32;
            // Two new tetrahedra meet over each edge of the cavity's border: its two vertices identify the
            // pair.
            let local = corners.map(|w| if w == v { NONE } else { work.table.local(w) });
            for (slot, face) in FACES.iter().enumerate() {
                if slot == apex {
                    continue;
                }
                let mut ends = face.iter().filter(|&&k| k != apex).map(|&k| local[k]);
                let (Some(a), Some(b)) = (ends.next(), ends.next()) else {
                    continue;
                };
                let payload = id << 2 | slot as u32;
                if let Some(twin) = work.table.pair(a, b, payload) {
                    t.n[slot] = twin;
                    let (tet, back) = ((twin >> 2) as usize, (twin & 3) as usize);
                    if tet == id as usize {
                        t.n[back] = payload;
                    } else {
                        self.tets[tet].n[back] = payload;
                    }
                }
            }
            self.tets[id as usize] = t;
        }
        work.table.reset(true);
        self.work = work;
        Inserted::At(last)
    }

    /// Frees tetrahedra that nothing refers to any more, for later insertions.
    pub(super) fn release(&mut self, tets: &[u32]) {
        self.work.free.extend(tets);
        self.work.grow_marks(self.tets.len());
    }

    /// Removes the free slots that insertions have left.
    pub(super) fn compact(&mut self) {
        let free = std::mem::take(&mut self.work.free);
        if !free.is_empty() {
            let mut dead = vec![false; self.tets.len()];
            free.iter().for_each(|&t| dead[t as usize] = true);
            let mut renumbered = Vec::with_capacity(self.tets.len());
            let mut count = 0_u32;
            for d in &dead {
                renumbered.push(if *d { NONE } else { count });
                count += u32::from(!d);
            }
            let mut flags = dead.iter();
            self.tets.retain(|_| flags.next() == Some(&false));
            for t in &mut self.tets {
                t.n = t.n.map(|n| renumbered[(n >> 2) as usize] << 2 | (n & 3));
            }
        }
        self.work.reset();
        self.work.grow_marks(self.tets.len());
    }
}

/// Moves infinity to slot 3 by an even permutation, which keeps the orientation. Also returns the slot to
/// which the vertex of slot 3 went.
fn with_infinity_last(mut v: [u32; 4]) -> ([u32; 4], usize) {
    match v[..3].iter().position(|&w| w == INF) {
        None => (v, 3),
        Some(slot) => {
            v.swap(slot, 3);
            let (a, b) = ((slot + 1) % 3, (slot + 2) % 3);
            v.swap(a, b);
            (v, slot)
        }
    }
}
