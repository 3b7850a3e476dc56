//! Visitors: optional work on each bond while its forces are computed.

use super::lanes::Lanes;
use super::law::{Law, Rigidity};
use super::span::Slot;

/// Receives every slot of half-bonds while forces are gathered.
pub(crate) trait Visitor<L: Lanes, W: Law> {
    fn begin(&mut self, particles: &W::Ready<L>);
    fn visit(
        &mut self,
        k: &Rigidity<L>,
        index: usize,
        slot: &Slot,
        particles: &W::Ready<L>,
        near: &W::Near<L>,
    );
    /// Called when block `b` of the part is finished.
    #[inline(always)]
    fn end(&mut self, _b: usize) {}
}

/// The empty visitor: does nothing and costs nothing.
impl<L: Lanes, W: Law> Visitor<L, W> for () {
    #[inline(always)]
    fn begin(&mut self, _: &W::Ready<L>) {}
    #[inline(always)]
    fn visit(&mut self, _: &Rigidity<L>, _: usize, _: &Slot, _: &W::Ready<L>, _: &W::Near<L>) {}
}

/// Calls two visitors one after the other.
impl<L: Lanes, W: Law, A: Visitor<L, W>, B: Visitor<L, W>> Visitor<L, W> for (A, B) {
    #[inline(always)]
    fn begin(&mut self, particles: &W::Ready<L>) {
        self.0.begin(particles);
        self.1.begin(particles);
    }
    #[inline(always)]
    fn visit(
        &mut self,
        k: &Rigidity<L>,
        index: usize,
        slot: &Slot,
        particles: &W::Ready<L>,
        near: &W::Near<L>,
    ) {
        self.0.visit(k, index, slot, particles, near);
        self.1.visit(k, index, slot, particles, near);
    }
    #[inline(always)]
    fn end(&mut self, b: usize) {
        self.0.end(b);
        self.1.end(b);
    }
}

/// Sums the energies of half-bonds; each has the energy of its bond, counted once from either end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Energy<L: Lanes> {
    l: L,
    sum: L::V,
}

impl<L: Lanes> Energy<L> {
    #[inline(always)]
    pub(crate) fn new(l: L) -> Self {
        Self { l, sum: l.splat(0.0) }
    }

    /// Energy \[J\] of the visited bonds: half the sum, because each bond is visited from both ends.
    #[inline(always)]
    pub(crate) fn total(&self) -> f64 {
        // Lanes are added at the end: in the loop each lane has a sum of its own.
        0.5 * self.l.store(self.sum).iter().sum::<f64>()
    }
}

impl<L: Lanes, W: Law> Visitor<L, W> for Energy<L> {
    #[inline(always)]
    fn begin(&mut self, _: &W::Ready<L>) {}
    #[inline(always)]
    fn visit(&mut self, k: &Rigidity<L>, _: usize, slot: &Slot, particles: &W::Ready<L>, near: &W::Near<L>) {
        self.sum = self.l.add(self.sum, W::energy(self.l, k, slot, particles, near));
    }
}
