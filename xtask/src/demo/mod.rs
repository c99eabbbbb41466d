//! The whole of it in order: simulate, train, touch the pegs, build the bank, identify holes, report.

mod summary;

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;

use crate::error::{Error, Result};
use crate::step::{Notes, Step, read_json};
use crate::workspace::Workspace;

/// Pairs of MAZE touches to train on: with more, training on two cores takes longer than a person waits.
const PAIRS: &str = "12000";

/// Episodes to evaluate: the protocol's.
const EPISODES: &str = "500";

/// The board of the paper's first table.
const BOARD: &str = "alphabet-small";

/// What `cargo xtask demo` takes.
#[derive(Args)]
pub struct DemoArgs {
    /// Skip training: use the checkpoint that comes with the project.
    #[arg(long)]
    quick: bool,
    /// Folder for everything it makes [default: demo in the workspace].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Seed of the boards, the touches and the training.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Builds the programs, runs them in order and says what came out.
pub fn demo(workspace: &Workspace, args: &DemoArgs) -> Result<()> {
    let start = Instant::now();
    let out = args.out.clone().unwrap_or_else(|| workspace.root.join("demo"));
    let out = std::path::absolute(&out).map_err(Error::io(&out))?;
    fs::create_dir_all(&out).map_err(Error::io(&out))?;
    let mut notes = Notes::open(&out, "demo")?;
    let steps = steps(workspace, args)?;
    workspace.build()?;

    println!("everything below happens in {}", out.display());
    for (n, step) in steps.iter().enumerate() {
        step.run(&format!("step {} of {}, {}", n + 1, steps.len(), step.name), &out, &mut notes)?;
    }
    let path = out.join("evaluation").join("evaluation.json");
    let evaluation = read_json(&path)?;
    println!();
    for line in summary::findings(&path, &evaluation)? {
        println!("{line}");
    }
    println!("{}", notes.times(&steps));
    println!("all of it, building included: {:.0} s", start.elapsed().as_secs_f64());
    println!("report: {}", out.join("evaluation").join("report.html").display());
    Ok(())
}

/// The programs in order. They run in the output folder, so their paths are short and the same for
/// every folder.
fn steps(workspace: &Workspace, args: &DemoArgs) -> Result<Vec<Step>> {
    let shipped = workspace.root.join("infer").join("models").join("maze-small.safetensors");
    if args.quick && !shipped.is_file() {
        return Err(Error::invalid(
            shipped.display().to_string(),
            "the checkpoint that comes with the project",
            "none",
        ));
    }
    let model = if args.quick { shipped } else { Path::new("model").join("model.safetensors") };
    let seed = args.seed.to_string();

    let step = |name: &str, program, words: &[&dyn AsRef<OsStr>]| Step {
        name: name.into(),
        program: workspace.program(program),
        args: words.iter().map(|word| word.as_ref().to_os_string()).collect(),
        inputs: Vec::new(),
        product: PathBuf::new(),
        proof: PathBuf::new(),
        resume_from: None,
    };
    let (mazes, pegs) = (Path::new("maze/meta.json"), Path::new("pegs/meta.json"));
    let training = [
        step(
            "MAZE touches",
            "tactile-data",
            &[&"generate", &"--scene", &"maze", &"--pairs", &PAIRS, &"--seed", &seed, &"--out", &"maze"],
        )
        .makes("maze", mazes),
        step("MAZE pictures", "tactile-data", &[&"inspect", &"maze", &"--sheet", &"maze.png"])
            .needs(mazes)
            .makes("maze.png", "maze.png"),
        step(
            "training",
            "tactile-train",
            &[&"--data", &"maze", &"--out", &"model", &"--preset", &"tiny", &"--seed", &seed],
        )
        .needs(mazes)
        .makes("model", &model)
        .resumes_from("model/state.safetensors"),
    ];
    let evaluation = [
        step(
            "peg touches",
            "tactile-data",
            &[&"generate", &"--scene", &BOARD, &"--sides", &"peg", &"--seed", &seed, &"--out", &"pegs"],
        )
        .makes("pegs", pegs),
        step("peg pictures", "tactile-data", &[&"inspect", &"pegs", &"--sheet", &"pegs.png"])
            .needs(pegs)
            .makes("pegs.png", "pegs.png"),
        step("bank", "tactile-infer", &[&"bank", &"--model", &model, &"--data", &"pegs", &"--out", &"pegs.bank"])
            .needs(&model)
            .needs(pegs)
            .makes("pegs.bank", "pegs.bank"),
        step(
            "evaluation",
            "tactile-filter",
            &[
                &"evaluate",
                &"--model",
                &model,
                &"--bank",
                &"pegs.bank",
                &"--scene",
                &BOARD,
                &"--pegs",
                &"pegs",
                &"--episodes",
                &EPISODES,
                &"--out",
                &"evaluation",
            ],
        )
        .needs(&model)
        .needs(pegs)
        .needs("pegs.bank")
        .makes("evaluation", "evaluation/evaluation.json"),
    ];
    Ok(training.into_iter().filter(|_| !args.quick).chain(evaluation).collect())
}
