//! The part of a partitioned model that one rank shows: the points that it owns, the cells whose first corner
//! it owns, and as ghosts the points of other ranks that these cells need.

use crate::cells::{self, Cell};
use crate::error::{Result, core};
use crate::ranks::elsewhere;
use crate::setup::{Grid, ModelInfo};
use arlequin::core::ranks::Message;
use arlequin::core::{Owned, Subdomain};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Points sent to another rank, and the number of points received from it.
#[derive(Debug, Default)]
struct Peer {
    send: Vec<u32>,
    receive: usize,
}

/// One rank's part of a model.
#[derive(Debug)]
pub(crate) struct Piece {
    /// Numbers of the points in the whole model: owned ones, then ghosts by rank and number.
    pub(super) points: Vec<u32>,
    /// Number of owned points.
    pub(super) owned: usize,
    /// Numbers of the cells in the whole model.
    pub(super) cells: Vec<u32>,
    /// Gradients in the cells, with local node numbers; `None` if they are not asked for or any rank failed.
    pub(super) centres: Option<Vec<Cell>>,
    /// Owned particle and bond (numbered in the whole model), for all bonds of owned particles; empty if
    /// bonds cannot break.
    pub(super) bonds: Vec<[u32; 2]>,
    peers: BTreeMap<usize, Peer>,
    nodes: Owned,
}

impl Piece {
    /// Restricts the grid of `info` to the points and cells that this rank shows, and computes the gradients
    /// in the cells if `gradients` is set. `None` for a model that is not partitioned. Collective.
    pub(super) fn cut(info: &mut ModelInfo, s: &Subdomain<f64>, gradients: bool) -> Result<Option<Self>> {
        let nodes = s.owned();
        let Some(portion) = nodes.portion() else {
            return Ok(None);
        };
        let (division, this_rank) = (portion.division(), portion.communicator().rank());
        let owner = |node: u32| division.owner(node as usize);
        let whole = info.grid.clone();
        let corners = |k: u32| &whole.connectivity[k as usize * whole.corners..][..whole.corners];
        let cells: Vec<u32> = (0..whole.cells() as u32)
            .filter(|k| owner(corners(*k)[0]) == this_rank)
            .collect();
        let wanted = gradients && whole.cells() > 0;
        let centres =
            wanted.then(|| cells::selected("output.fields", info, cells.iter().map(|k| *k as usize)));
        let failed = centres.as_ref().is_some_and(Result::is_err);
        // All ranks go without gradients if one fails, so that all parts have the same arrays.
        let lost = nodes.any(failed).map_err(core("ranks"))?;
        let mut centres = centres.and_then(Result::ok).filter(|_| !lost);

        let shown_nodes = cells.iter().flat_map(|k| corners(*k)).copied();
        let gradient_nodes = centres.iter().flatten().flat_map(Cell::nodes);
        let remote_nodes = shown_nodes.chain(gradient_nodes).map(|node| (owner(node), node));
        let mut ghosts: Vec<(usize, u32)> = remote_nodes.filter(|g| g.0 != this_rank).collect();
        ghosts.sort_unstable();
        ghosts.dedup();
        let owned = portion.nodes();
        let local = |node: u32| {
            let place = || owned + ghosts.partition_point(|g| *g < (owner(node), node));
            portion.local(node as usize).unwrap_or_else(place)
        };
        if let Some(gradient_cells) = &mut centres {
            gradient_cells.iter_mut().for_each(|c| c.renumber(&local));
        }
        let owned_points = (0..owned).map(|k| portion.global(k) as u32);
        let points: Vec<u32> = owned_points.chain(ghosts.iter().map(|g| g.1)).collect();
        let point_numbers = || points.iter().map(|k| *k as usize);
        info.grid = Arc::new(Grid {
            points: point_numbers().map(|k| whole.points[k]).collect(),
            connectivity: cells
                .iter()
                .flat_map(|k| corners(*k))
                .map(|k| local(*k) as u32)
                .collect(),
            corners: whole.corners,
            cell_type: whole.cell_type,
            radii: match whole.radii.as_slice() {
                [] => Vec::new(),
                radii => point_numbers().map(|k| radii[k]).collect(),
            },
        });
        let mut bonds = Vec::new();
        if info.breaks.is_some() {
            let numbered = (0..).zip(whole.connectivity.chunks_exact(whole.corners));
            let ends = numbered.flat_map(|(b, ends): (u32, _)| ends.iter().map(move |i| (*i as usize, b)));
            bonds.extend(ends.filter_map(|(i, b)| Some([portion.local(i)? as u32, b])));
        }
        Ok(Some(Self {
            owned,
            cells,
            centres,
            bonds,
            peers: agree_peers(&nodes, this_rank, &ghosts)?,
            points,
            nodes,
        }))
    }

    /// Gathers values with `components` numbers per point: `owned_values` of the owned points, then those of
    /// the ghosts from other ranks. Collective.
    pub(super) fn with_ghosts(&self, components: usize, owned_values: &[f64]) -> Result<Vec<f64>> {
        let values_of = |k: &u32| {
            owned_values[components * *k as usize..]
                .iter()
                .take(components)
                .copied()
        };
        let message = |(rank, p): (&usize, &Peer)| Message {
            peer: *rank,
            out: p.send.iter().flat_map(values_of).collect(),
            into: vec![0.0; components * p.receive],
        };
        let mut messages: Vec<Message> = self.peers.iter().map(message).collect();
        if let Some(portion) = self.nodes.portion() {
            portion
                .communicator()
                .exchange(&mut messages)
                .map_err(elsewhere)?;
        }
        // `peers` is sorted by rank, and so are the ghosts.
        let ghosts = messages.iter().flat_map(|m| &m.into);
        Ok(owned_values.iter().chain(ghosts).copied().collect())
    }
}

/// Agrees with the other ranks on what each exchange sends and receives. `ghosts` are given by rank and
/// number. Collective.
fn agree_peers(nodes: &Owned, this_rank: usize, ghosts: &[(usize, u32)]) -> Result<BTreeMap<usize, Peer>> {
    // One word per ghost: the rank that asks in the high half, the node in the low half.
    let words = ghosts.iter().map(|g| (this_rank as i64) << 32 | i64::from(g.1));
    let requests = nodes.all_gather(words.collect()).map_err(core("ranks"))?;
    let mut peers: BTreeMap<usize, Peer> = BTreeMap::new();
    for (rank, _) in ghosts {
        peers.entry(*rank).or_default().receive += 1;
    }
    for word in requests {
        let node = (word & i64::from(u32::MAX)) as usize;
        if let Some(local) = nodes.local(node) {
            let peer = peers.entry((word >> 32) as usize).or_default();
            peer.send.push(local as u32);
        }
    }
    Ok(peers)
}
