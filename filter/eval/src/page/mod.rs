//! What every HTML page of this crate is made of: the shell with its style and its script, tables, numbers and charts.

pub mod axes;
pub mod curves;
pub mod model;
pub mod numbers;
pub mod scatter;
pub mod shell;
pub mod table;
