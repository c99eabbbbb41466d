//! A state of the filter.

/// One state: which part, and where on it the first touch was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Hypothesis {
    /// Index of the part in the bank.
    pub part: usize,
    /// Cell of [`Belief::grid`](crate::belief::Belief::grid) that holds `part_from_first_sensor`.
    pub cell: usize,
}
