//! What a program does when its standard output is closed: `tactile-data inspect boards | head -1`.

use std::io::{self, Write};
use std::panic;
use std::process;

/// Makes a failure to print end the program with exit code 1 instead of a panic: in silence where the reader has
/// gone away, as `head` does, and with one line of error for any other cause.
pub fn fail_in_one_line() {
    let report = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        let Some(why) = panic.payload_as_str().and_then(|what| what.strip_prefix("failed printing to stdout: ")) else {
            return report(panic);
        };
        if !why.starts_with("Broken pipe") {
            // Standard error may be closed as well.
            let _ = writeln!(io::stderr(), "error: standard output: {why}");
        }
        process::exit(1);
    }));
}
