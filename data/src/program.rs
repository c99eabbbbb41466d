//! What the `main` of every program does with its work: threads, the error in one line, the exit code.

pub mod closed_output;
pub mod drawn;
pub mod progress;

use std::error::Error;
use std::fmt::Display;
use std::process::{ExitCode, Termination};
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::text::printable::{printable, printable_lines};

/// Stack of a thread, bytes: as large as a main thread's.
const STACK_BYTES: usize = 8 << 20;

/// Runs `work` inside the global rayon pool, so that the libraries, which share their work among the threads of the pool
/// that they are called in, use all cores.
///
/// An error is one line on standard error and exit code 1. Nobody reading standard output ends the program in silence
/// ([`closed_output`]). Call it once, from `main`, when the command line is understood.
pub fn run<T: Termination + Send, E: Display + Send>(work: impl FnOnce() -> Result<T, E> + Send) -> ExitCode {
    closed_output::fail_in_one_line();
    if let Err(error) = rayon::ThreadPoolBuilder::new().stack_size(STACK_BYTES).build_global() {
        return failed(error);
    }
    match rayon::scope(|_| work()) {
        Ok(done) => done.report(),
        Err(error) => failed(error),
    }
}

/// The parser of a flag whose value is one of these names.
pub fn named<T>(names: impl Into<PossibleValuesParser>) -> impl TypedValueParser<Value = T>
where
    T: FromStr + Clone + Send + Sync + 'static,
    T::Err: Into<Box<dyn Error + Send + Sync>>,
{
    names.into().try_map(|name| name.parse())
}

fn failed(error: impl Display) -> ExitCode {
    eprintln!("error: {}", printable(&error.to_string()));
    ExitCode::FAILURE
}

/// Prints a result, of one line or several, with what a terminal would obey of it escaped.
pub fn say(text: impl Display) {
    println!("{}", printable_lines(&text.to_string()));
}

/// Prints a line of warning on standard error: the result may not be what was meant.
pub fn warning(text: impl Display) {
    eprintln!("warning: {}", printable(&text.to_string()));
}

/// Prints a line on standard error that is good to know.
pub fn note(text: impl Display) {
    eprintln!("note: {}", printable(&text.to_string()));
}
