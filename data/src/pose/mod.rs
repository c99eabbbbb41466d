//! Poses in the plane, the grids that they are recorded on, and the turns after which a part is the same.

pub mod grid;
pub mod grid_fit;
pub mod se2;
pub mod symmetry;
