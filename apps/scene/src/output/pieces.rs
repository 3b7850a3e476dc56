//! What one rank shows of a model in parts: the points that it holds, the cells whose first corner is among
//! them, and, as ghosts, the points of other ranks that these cells need.

use crate::cells::{self, Cell};
use crate::error::Result;
use crate::ranks::elsewhere;
use crate::setup::{Grid, ModelInfo};
use arlequin::core::ranks::{Message, Portion};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What another rank is sent, and how many points come from it.
#[derive(Debug, Default)]
struct Peer {
    send: Vec<u32>,
    receive: usize,
}

/// One rank's piece of a model.
#[derive(Debug)]
pub(super) struct Piece {
    /// Numbers of its points in the whole model: own ones, then ghosts by rank and number.
    pub(super) points: Vec<u32>,
    /// How many are own ones.
    pub(super) own: usize,
    /// Numbers of its cells in the whole model.
    pub(super) cells: Vec<u32>,
    /// Gradients in the cells, by the points here; none where no rank has them.
    pub(super) centres: Option<Vec<Cell>>,
    /// Own particle and bond, by its number in the whole model, of all bonds of own particles; empty where
    /// none can break.
    pub(super) bonds: Vec<[u32; 2]>,
    peers: BTreeMap<usize, Peer>,
}

impl Piece {
    /// Leaves of a picture what this rank shows, with the gradients in its cells if they are wanted. All
    /// ranks must ask.
    pub(super) fn cut(info: &mut ModelInfo, portion: &Portion, gradients: bool) -> Result<Self> {
        let (division, mine) = (portion.division(), portion.communicator().rank());
        let owner = |node: u32| division.owner(node as usize);
        let whole = info.grid.clone();
        let corners = |k: u32| &whole.connectivity[k as usize * whole.corners..][..whole.corners];
        let cells: Vec<u32> = (0..whole.cells() as u32)
            .filter(|k| owner(corners(*k)[0]) == mine)
            .collect();
        let wanted = gradients && whole.cells() > 0;
        let centres =
            wanted.then(|| cells::selected("output.fields", info, cells.iter().map(|k| *k as usize)));
        let failed = centres.as_ref().is_some_and(Result::is_err);
        let lost = portion.any(failed).map_err(elsewhere)?;
        let mut centres = centres.and_then(Result::ok).filter(|_| !lost);

        let shown = cells.iter().flat_map(|k| corners(*k)).copied();
        let felt = centres.iter().flatten().flat_map(Cell::nodes);
        let others = shown.chain(felt).map(|node| (owner(node), node));
        let mut ghosts: Vec<(usize, u32)> = others.filter(|g| g.0 != mine).collect();
        ghosts.sort_unstable();
        ghosts.dedup();
        let own = portion.nodes();
        let local = |node: u32| {
            let place = || own + ghosts.partition_point(|g| *g < (owner(node), node));
            portion.local(node as usize).unwrap_or_else(place)
        };
        if let Some(all) = &mut centres {
            all.iter_mut().for_each(|c| c.renumber(&local));
        }
        let here = (0..own).map(|k| portion.global(k) as u32);
        let points: Vec<u32> = here.chain(ghosts.iter().map(|g| g.1)).collect();
        let of_points = || points.iter().map(|k| *k as usize);
        info.grid = Arc::new(Grid {
            points: of_points().map(|k| whole.points[k]).collect(),
            connectivity: cells
                .iter()
                .flat_map(|k| corners(*k))
                .map(|k| local(*k) as u32)
                .collect(),
            corners: whole.corners,
            cell_type: whole.cell_type,
            radii: match whole.radii.as_slice() {
                [] => Vec::new(),
                radii => of_points().map(|k| radii[k]).collect(),
            },
        });
        let mut bonds = Vec::new();
        if info.breaks.is_some() {
            let all = (0..).zip(whole.connectivity.chunks_exact(whole.corners));
            let ends = all.flat_map(|(b, ends): (u32, _)| ends.iter().map(move |i| (*i as usize, b)));
            bonds.extend(ends.filter_map(|(i, b)| Some([portion.local(i)? as u32, b])));
        }
        Ok(Self {
            own,
            cells,
            centres,
            bonds,
            peers: asked(portion, &ghosts)?,
            points,
        })
    }

    /// Numbers of all points here, so many each, of which `own` are those of own ones. All ranks must ask.
    pub(super) fn told(&self, portion: &Portion, each: usize, own: &[f64]) -> Result<Vec<f64>> {
        let of = |k: &u32| own[each * *k as usize..].iter().take(each).copied();
        let message = |(rank, p): (&usize, &Peer)| Message {
            peer: *rank,
            out: p.send.iter().flat_map(of).collect(),
            into: vec![0.0; each * p.receive],
        };
        let mut messages: Vec<Message> = self.peers.iter().map(message).collect();
        let told = portion.communicator().exchange(&mut messages, &mut || false);
        told.map_err(elsewhere)?;
        // In the order of ranks, as ghosts are.
        let ghosts = messages.iter().flat_map(|m| &m.into);
        Ok(own.iter().chain(ghosts).copied().collect())
    }
}

/// Asks the ranks of ghosts, given by rank and number, to tell of them whenever all do; hears what others
/// ask for.
fn asked(portion: &Portion, ghosts: &[(usize, u32)]) -> Result<BTreeMap<usize, Peer>> {
    let mine = portion.communicator().rank() as i64;
    let words: Vec<i64> = ghosts.iter().map(|g| mine << 32 | i64::from(g.1)).collect();
    let all = portion.listed(&words).map_err(elsewhere)?;
    let mut peers: BTreeMap<usize, Peer> = BTreeMap::new();
    for (rank, _) in ghosts {
        peers.entry(*rank).or_default().receive += 1;
    }
    for word in all {
        let node = (word & i64::from(u32::MAX)) as usize;
        if let Some(here) = portion.local(node) {
            let by = peers.entry((word >> 32) as usize).or_default();
            by.send.push(here as u32);
        }
    }
    Ok(peers)
}
