//! Halo of nodes that are near this rank's nodes at their present positions.

use super::halo::Peer;
use super::{Halo, Message, Portion, RankError};
use crate::{Owned, Result};

/// Lower corner, then upper one. An empty box runs from infinity to minus infinity.
type Corners = [f64; 6];

fn corners(points: &[[f64; 3]]) -> Corners {
    let lowest = |c: usize| points.iter().map(|x| x[c]).fold(f64::INFINITY, f64::min);
    let highest = |c: usize| points.iter().map(|x| x[c]).fold(f64::NEG_INFINITY, f64::max);
    std::array::from_fn(|k| if k < 3 { lowest(k) } else { highest(k - 3) })
}

impl Halo {
    /// Finds all ghosts that may lie within `reach` \[m\] of a node of this rank: those within `reach` of the
    /// box around its nodes. `points`: present positions of this rank's nodes \[m\]. Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn near(owned: &Owned, points: &[[f64; 3]], reach: f64) -> Result<Self> {
        let Some(portion) = owned.portion() else {
            return Ok(Self::none(owned));
        };
        let own_rank = portion.communicator().rank();
        let own_box = corners(points);
        let boxes = owned.all_gather(own_box.map(|x| x.to_bits().cast_signed()).to_vec())?;
        let boxes = boxes.as_chunks::<6>().0.iter();
        let boxes = boxes.map(|b| b.map(|x| f64::from_bits(x.cast_unsigned())));
        // Both ranks make the same two comparisons, so that they agree on being neighbours.
        let meet =
            |b: &Corners| (0..3).all(|c| own_box[c] - reach <= b[3 + c] && b[c] - reach <= own_box[3 + c]);
        let inside =
            |b: &Corners, x: &[f64; 3]| (0..3).all(|c| x[c] >= b[c] - reach && x[c] <= b[3 + c] + reach);
        let mut peers = Vec::new();
        for (rank, b) in boxes.enumerate().filter(|(r, b)| *r != own_rank && meet(b)) {
            let send = (0..).zip(points).filter(|(_, x)| inside(&b, x));
            peers.push(Peer {
                rank,
                send: send.map(|(node, _)| node).collect(),
                receive: 0..0,
            });
        }
        let message = |p: &Peer, out: Vec<f64>, count: usize| Message {
            peer: p.rank,
            out,
            into: vec![0.0; count],
        };
        // A receiver has to know the length of a message beforehand.
        let counts = peers.iter().map(|p| message(p, vec![p.send.len() as f64], 1));
        let counts: Vec<usize> = exchange(portion, counts.collect())?
            .map(|m| m.into[0] as usize)
            .collect();
        let global = |p: &Peer| {
            p.send
                .iter()
                .map(|i| portion.global(*i as usize) as f64)
                .collect()
        };
        let numbers = peers.iter().zip(&counts).map(|(p, n)| message(p, global(p), *n));
        let numbers = exchange(portion, numbers.collect())?;
        let mut ghosts = Vec::with_capacity(counts.iter().sum());
        for (p, m) in peers.iter_mut().zip(numbers) {
            p.receive = ghosts.len()..ghosts.len() + m.into.len();
            ghosts.extend(m.into.iter().map(|x| *x as u32));
        }
        // Boxes may be near each other although no nodes are; both ranks then drop the pair.
        peers.retain(|p| !(p.send.is_empty() && p.receive.is_empty()));
        Ok(Self {
            owned: owned.clone(),
            peers,
            ghosts,
        })
    }
}

fn exchange(portion: &Portion, mut messages: Vec<Message>) -> Result<std::vec::IntoIter<Message>, RankError> {
    portion.keep(portion.communicator().exchange(&mut messages))?;
    Ok(messages.into_iter())
}
