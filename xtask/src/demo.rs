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

/// A bank for touches anywhere, of pegs alone and compared by the cosine.
const NO_AID: &str = "--views pegs --learn-from nothing --xy-step-mm 2 --theta-step-deg 15";

/// The board of the paper's first table.
const BOARD: &str = "alphabet-small";

/// The folder of what is shown first: holes touched anywhere, at any angle.
const ANYWHERE: &str = "evaluation";

/// The folder of the paper's protocol: the offered motions lead exactly to recorded poses, which gives the pose away.
const PAPER: &str = "paper-protocol";

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

/// Builds the programs, runs them in order: the last prints what came out of touches anywhere, the one before it what
/// came out of the paper's protocol, and its report compares that with the paper.
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

    for (folder, what) in [(PAPER, "the paper's protocol, at recorded poses"), (ANYWHERE, "touched anywhere")] {
        println!("report, {what}: {}", out.join(folder).join("report.html").display());
    }
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

/// The steps from the pegs to the reports.
fn evaluation(workspace: &Workspace, seed: u64, model: &Path) -> Vec<Step> {
    let [data, infer, filter] = ["tactile-data", "tactile-infer", "tactile-filter"].map(|name| workspace.program(name));
    let pegs = format!("generate --scene {BOARD} --sides peg --seed {seed} --out pegs");
    let pictures = data.clone().words("inspect pegs --sheet pegs.png");
    let bank = infer.clone().words("bank --model").arg(model).words("--data pegs --out pegs.bank");
    let fine = infer.words("bank --model").arg(model);
    let fine = fine.words(format!("--scene {BOARD} {NO_AID} --seed {seed} --out fine.bank"));
    let evaluate = |bank: &str, more: &str, out: &str| {
        let program = filter.clone().words("evaluate --model").arg(model);
        let program = program.words(format!("--bank {bank} --scene {BOARD} --episodes {EPISODES} {more} --out {out}"));
        Step::new(out, program, out).with_last("evaluation.json").needs(model).needs(bank)
    };
    vec![
        Step::new("peg touches", data.words(pegs), "pegs").with_last("meta.json"),
        Step::new("peg pictures", pictures, "pegs.png").needs("pegs/meta.json"),
        Step::new("bank", bank, "pegs.bank").needs(model).needs("pegs/meta.json"),
        Step::new("fine bank", fine, "fine.bank").needs(model),
        evaluate("pegs.bank", "--engines exact,paper --actions information --pegs pegs", PAPER).needs("pegs/meta.json"),
        evaluate("fine.bank", "--poses off-grid --engines exact --actions information,random", ANYWHERE),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_word_is_of_touches_anywhere_without_an_aid() {
        let workspace = Workspace { root: "/r".into(), target: "/t".into() };
        let steps = evaluation(&workspace, 1, Path::new("/m"));
        let command = |name: &str| steps.iter().find(|step| step.name == name).unwrap().command();
        let last = steps.last().unwrap();
        assert_eq!(last.name, ANYWHERE);
        assert!(last.command().contains("--poses off-grid") && last.command().contains("--bank fine.bank"));
        let fine = command("fine bank");
        assert!(fine.contains("--views pegs --learn-from nothing --xy-step-mm 2 --theta-step-deg 15"), "{fine}");
        assert!(!command(PAPER).contains("off-grid") && command(PAPER).contains("exact,paper"));
    }
}
