//! What a program does when nobody reads its output any more: `tactile-data inspect boards | head -1`.

use std::io::{self, Write};
use std::panic;
use std::process;

/// Makes printing to a closed output end the program with one line of error and exit code 1 instead of a panic.
pub fn fail_in_one_line() {
    let report = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        let Some(why) = panic.payload_as_str().and_then(|what| what.strip_prefix("failed printing to stdout: ")) else {
            return report(panic);
        };
        // Standard error may be as closed.
        let _ = writeln!(io::stderr(), "error: standard output: {why}");
        process::exit(1);
    }));
}
