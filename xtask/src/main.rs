//! `cargo xtask`: the project's chores. It runs programs and knows no crate.

mod bench;
mod capi;
mod certify;
mod code;
mod dds;
mod demo;
mod error;
mod experiments;
mod figures;
mod json;
mod lab;
mod live;
mod page;
mod program;
mod python;
mod real;
mod reproduce;
mod step;
mod tidy;
mod validate;
mod wgpu;
mod wheel;
mod workspace;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::Result;
use crate::program::Program;
use crate::workspace::Workspace;

/// The project's chores.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Cli {
    #[command(subcommand)]
    command: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Simulate, train, touch the pegs, identify holes, report.
    #[command(after_help = "Example:\n  cargo xtask demo --quick --out demo")]
    Demo(demo::DemoArgs),
    /// Everything that a change must pass: tests, format, lints, docs, tidy.
    #[command(after_help = "Example:\n  cargo xtask ci")]
    Ci,
    /// Measure how fast something is.
    #[command(subcommand, after_help = "Example:\n  cargo xtask bench sensor")]
    Bench(bench::Bench),
    /// Compare the simulated sensor with real images, and write a report.
    #[command(after_help = "Example:\n  cargo xtask validate --real ../shared/real-gelsight --out validation")]
    Validate(validate::ValidateArgs),
    /// Name real presses among simulated parts, and write a report.
    #[command(after_help = "Example:\n  cargo xtask real --real ../shared/real-gelsight --out real")]
    Real(real::RealArgs),
    /// Every table and figure of the paper and the trade of speed for accuracy, on one page.
    #[command(
        after_help = "Example:\n  cargo xtask reproduce --smoke\n  cargo xtask reproduce --part tables --part hard"
    )]
    Reproduce(reproduce::ReproduceArgs),
    /// Fit how sure a name is by networks of maps, to episodes with the part and with strangers.
    #[command(
        after_help = "Example:\n  cargo xtask certify --maps out/verifier/maps.safetensors --out out/certification"
    )]
    Certify(certify::CertifyArgs),
    /// Write the figures of the documents' tables, from figures.json or from what reproduce left in a folder.
    #[command(after_help = "Example:\n  cargo xtask figures --from reproduction")]
    Figures(figures::FiguresArgs),
    /// A lab's recordings through the whole chain, simulated: with a robot's errors, as pictures and as bags.
    #[command(after_help = "Example:\n  cargo xtask lab --out lab")]
    Lab(lab::LabArgs),
    /// Compare a forward pass in numpy with tactile-infer's, from the weights' file alone.
    #[command(after_help = "Example:\n  cargo xtask python")]
    Python(python::PythonArgs),
    /// Build the Python wheel, install it into a fresh virtual environment and try it.
    #[command(after_help = "Example:\n  cargo xtask wheel\n  cargo xtask wheel --out dist")]
    Wheel(wheel::WheelArgs),
    /// The C library: install it, or check it with compilers, valgrind, sanitizers and CMake, and measure it.
    #[command(after_help = "Example:\n  cargo xtask capi --install /usr/local")]
    Capi(capi::CapiArgs),
    /// Compare our ROS 2 topics and services with CycloneDDS: nothing lost, nothing changed, nothing that ends the node.
    #[command(after_help = "Example:\n  cargo xtask dds --seconds 600\n  cargo xtask dds --node --middleware fastdds")]
    Dds(dds::DdsArgs),
    /// Check the live views with a viewer of our own: what is advertised, and each message byte for byte.
    #[command(after_help = "Example:\n  cargo xtask views")]
    Views,
    /// Compare the graphics card (or Mesa's llvmpipe) with the CPU: embeddings and first training steps.
    #[command(after_help = "Example:\n  cargo xtask wgpu")]
    Wgpu,
    /// Check the rules that no compiler checks.
    #[command(after_help = "Example:\n  cargo xtask tidy")]
    Tidy,
}

fn main() -> ExitCode {
    match run(&Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(chore: &Chore) -> Result<()> {
    let workspace = Workspace::find()?;
    match chore {
        Chore::Demo(args) => demo::demo(&workspace, args),
        Chore::Ci => ci(&workspace),
        Chore::Bench(bench) => bench::bench(&workspace, bench),
        Chore::Validate(args) => validate::validate(&workspace, args),
        Chore::Real(args) => real::real(&workspace, args),
        Chore::Reproduce(args) => {
            let whole = reproduce::reproduce(&workspace, args)?;
            figures::after(&workspace, whole.as_deref())
        }
        Chore::Certify(args) => certify::certify(&workspace, args),
        Chore::Figures(args) => figures::figures(&workspace, args),
        Chore::Lab(args) => lab::lab(&workspace, args),
        Chore::Python(args) => python::python(&workspace, args),
        Chore::Wheel(args) => wheel::wheel(&workspace, args),
        Chore::Capi(args) => capi::capi(&workspace, args),
        Chore::Dds(args) => dds::dds(&workspace, args),
        Chore::Views => dds::views(&workspace),
        Chore::Wgpu => wgpu::wgpu(&workspace),
        Chore::Tidy => tidy::tidy(&workspace),
    }
}

/// Runs `.ci/run`, the one list of what a change must pass.
fn ci(workspace: &Workspace) -> Result<()> {
    Program::new("bash").words(".ci/run").run(&workspace.root).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
