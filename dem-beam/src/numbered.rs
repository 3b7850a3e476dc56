//! Numbers that the bonds of a rank's part have in the whole body.

use std::sync::Arc;

/// Numbers of the bonds of a part in the whole body, and the number of all bonds of the body.
#[derive(Debug, Clone)]
pub(crate) struct Numbered {
    /// Number of each bond of the part in the whole body, ascending.
    pub(crate) bonds: Arc<[u32]>,
    /// Number of all bonds of the whole body.
    pub(crate) total: usize,
}
