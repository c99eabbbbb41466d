//! The whole chain in order: simulate, train, touch the pegs, build the bank, identify holes, report.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::{Error, Result};
use crate::live::live;
use crate::step::{self, Step};
use crate::workspace::Workspace;

/// Pairs of MAZE touches to train on: with more, training on two cores takes longer than a person waits.
const PAIRS: usize = 12_000;

/// Episodes to evaluate: the protocol's.
const EPISODES: usize = 500;

/// The board of the paper's first table.
const BOARD: &str = "alphabet-small";

/// What `cargo xtask demo` takes.
#[derive(Args)]
pub struct DemoArgs {
    /// Skip training: use the checkpoint that comes with the project.
    #[arg(long)]
    quick: bool,
    /// Instead: the live node and a simulated robot, two processes on a ROS 2 network of this machine.
    #[arg(long, conflicts_with = "quick")]
    live: bool,
    /// Folder for everything it makes [default: demo, or demo-live, in the workspace].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Seed of the boards, the touches and the training.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Builds the programs, runs them in order: the last prints what came out, and its report compares it with the paper.
pub fn demo(workspace: &Workspace, args: &DemoArgs) -> Result<()> {
    if args.live {
        return live(workspace, args.out.as_deref(), args.seed);
    }
    let shipped = workspace.shipped_model();
    if args.quick && !shipped.is_file() {
        return Err(Error::invalid(shipped.display().to_string(), "the model that comes with the project", "none"));
    }
    let out = workspace.folder(args.out.as_deref(), Path::new("demo"))?;
    let (training, trained) = training(workspace, args.seed);
    let (mut steps, model) = if args.quick { (Vec::new(), shipped) } else { (training, trained) };
    steps.extend(evaluation(workspace, args.seed, &model));
    step::run_all("demo", &steps, workspace, &out)?;

    println!("report: {}", out.join("evaluation").join("report.html").display());
    Ok(())
}

/// The steps that make a model, and its file. They run in the output folder, so their paths are short and the same
/// for every folder.
fn training(workspace: &Workspace, seed: u64) -> (Vec<Step>, PathBuf) {
    let [data, train] = ["tactile-data", "tactile-train"].map(|name| workspace.program(name));
    let mazes = format!("generate --scene maze --pairs {PAIRS} --seed {seed} --out maze");
    let pictures = data.clone().words("inspect maze --sheet maze.png");
    let train = train.words(format!("--data maze --out model --preset tiny --seed {seed}"));
    let steps = vec![
        Step::new("MAZE touches", data.words(mazes), "maze").with_last("meta.json"),
        Step::new("MAZE pictures", pictures, "maze.png").needs("maze/meta.json"),
        Step::new("training", train, "model")
            .with_last("model.safetensors")
            .needs("maze/meta.json")
            .resumes_from("state.safetensors"),
    ];
    (steps, PathBuf::from("model/model.safetensors"))
}

/// The steps from the pegs to the report.
fn evaluation(workspace: &Workspace, seed: u64, model: &Path) -> Vec<Step> {
    let [data, infer, filter] = ["tactile-data", "tactile-infer", "tactile-filter"].map(|name| workspace.program(name));
    let pegs = format!("generate --scene {BOARD} --sides peg --seed {seed} --out pegs");
    let pictures = data.clone().words("inspect pegs --sheet pegs.png");
    let bank = infer.words("bank --model").arg(model).words("--data pegs --out pegs.bank");
    let evaluate = filter
        .words("evaluate --model")
        .arg(model)
        .words(format!("--bank pegs.bank --scene {BOARD} --pegs pegs --episodes {EPISODES} --out evaluation"));
    vec![
        Step::new("peg touches", data.words(pegs), "pegs").with_last("meta.json"),
        Step::new("peg pictures", pictures, "pegs.png").needs("pegs/meta.json"),
        Step::new("bank", bank, "pegs.bank").needs(model).needs("pegs/meta.json"),
        Step::new("evaluation", evaluate, "evaluation")
            .with_last("evaluation.json")
            .needs(model)
            .needs("pegs/meta.json")
            .needs("pegs.bank"),
    ]
}
