//! The recorded views of all parts of a bank, as what is found of them needs them.

use tactile_data::grid::PoseGrid;

use crate::rows::Rows;

/// Views on a grid of poses, part-major, then grid cell.
#[derive(Clone, Copy)]
pub(crate) struct Views<'a> {
    /// The poses of each part.
    pub grid: &'a PoseGrid,
    /// Embeddings, a row each.
    pub rows: &'a Rows,
    /// Share of each view that shows an edge, 0..=1.
    pub edge_shares: &'a [f32],
    /// Rows that were not recorded, in order.
    pub missing: &'a [usize],
}
