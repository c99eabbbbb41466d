//! `cargo xtask certify`: how sure a name is by maps, fitted to episodes with the part and with strangers.

use std::fs;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::error::{Error, Result};
use crate::program::Program;
use crate::step::{self, Step};
use crate::workspace::Workspace;

/// What `cargo xtask certify` takes.
#[derive(Args)]
pub struct CertifyArgs {
    /// The networks that draw and verify by maps (`tactile-train --verifier`); they stay as they are.
    #[arg(long)]
    maps: PathBuf,
    /// The model that they were trained for [default: the one that comes with the project]
    #[arg(long)]
    model: Option<PathBuf>,
    /// Only what these touches say [default: all]
    #[arg(long, value_enum)]
    only: Vec<Touches>,
    /// Banks of twelve parts of each kind.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=5))]
    banks: u32,
    /// Folder for everything it makes, the networks with their fits among it: maps.safetensors [default: certification in the workspace]
    #[arg(long)]
    out: Option<PathBuf>,
}

/// What is touched, and what the bank knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Touches {
    /// Holes, in banks of both sides.
    Both,
    /// Holes, in banks of pegs.
    Pegs,
    /// Raised parts, in banks of pegs.
    Raised,
}

/// Kinds of parts, each with the seed of its first bank: of any size; of nearly one size; whole and with a piece cut off; as they are and
/// longer; with and without a bar. What one bank has of the last three are each other's strangers.
const KINDS: [(&str, u32); 5] = [("calibration", 400), ("alike", 420), ("cut", 440), ("sizes", 460), ("bars", 480)];

/// Parts of a bank.
const N_PARTS: u32 = 12;

impl Touches {
    fn name(self) -> &'static str {
        match self {
            Self::Both => "both",
            Self::Pegs => "pegs",
            Self::Raised => "raised",
        }
    }

    /// The bank's name and how it is made.
    fn bank(self) -> [&'static str; 2] {
        match self {
            Self::Both => ["both", ""],
            Self::Pegs | Self::Raised => ["pegs", "--views pegs --learn-from nothing"],
        }
    }

    /// How touches are evaluated, and what is added to their seeds.
    fn evaluated(self) -> (&'static str, u32) {
        if self == Self::Raised { ("--side peg", 200) } else { ("", 0) }
    }
}

/// Makes the evaluations that are not there and fits to them.
pub fn certify(workspace: &Workspace, args: &CertifyArgs) -> Result<()> {
    let out = workspace.folder(args.out.as_deref(), "certification".as_ref())?;
    let path = |path: &PathBuf| path.canonicalize().map_err(Error::io(path));
    let model = path(args.model.as_ref().unwrap_or(&workspace.shipped_model()))?;
    let job = Job { workspace, model, maps: path(&args.maps)? };
    let certified = out.join("maps.safetensors");
    // By whatever path: a copy onto itself would leave nothing.
    if certified.canonicalize().is_ok_and(|path| path == job.maps) {
        return Err(Error::invalid(
            job.maps.display().to_string(),
            "networks in another folder than --out",
            "this one",
        ));
    }
    let only = if args.only.is_empty() { Touches::value_variants() } else { &args.only };
    let (steps, fits) = job.steps(only, args.banks);
    step::run_all("certify", &steps, workspace, &out)?;
    fs::copy(&job.maps, &certified).map_err(Error::io(&certified))?;
    for (touches, evaluations) in &fits {
        println!("== {}", touches.name());
        let program = workspace.program("tactile-filter").words("certify").words(evaluations.join(" "));
        program.words("--maps maps.safetensors").run(&out)?;
    }
    println!("{}", certified.display());
    Ok(())
}

/// What all steps have in common.
struct Job<'a> {
    workspace: &'a Workspace,
    model: PathBuf,
    maps: PathBuf,
}

impl Job<'_> {
    /// All steps, and the folders of the evaluations that each fit is to.
    fn steps(&self, only: &[Touches], n_banks: u32) -> (Vec<Step>, Vec<(Touches, Vec<String>)>) {
        let mut steps: Vec<Step> = Vec::new();
        let mut fits: Vec<(Touches, Vec<String>)> = only.iter().map(|touches| (*touches, Vec::new())).collect();
        for (bank, (kind, seed)) in (0..n_banks).flat_map(|bank| KINDS.map(|kind| (bank, kind))) {
            for (touches, evaluations) in &mut fits {
                let (made, names) = self.of_bank(*touches, kind, bank, seed + bank);
                evaluations.extend(names);
                for step in made {
                    // Holes and raised parts are touched in one bank.
                    if steps.iter().all(|before| before.name != step.name) {
                        steps.push(step);
                    }
                }
            }
        }
        (steps, fits)
    }

    fn program(&self, name: &str, words: &str) -> Program {
        self.workspace.program(name).words(words).arg("--model").arg(&self.model).arg("--maps").arg(&self.maps)
    }

    /// A bank, and its episodes with the part and with strangers, under the default sensor and under a drawn one; and their folders.
    fn of_bank(&self, touches: Touches, kind: &str, bank: u32, seed: u32) -> (Vec<Step>, Vec<String>) {
        let scene = self.workspace.root.join(format!("data/scenes/maze-parts-{kind}.toml"));
        let scene = format!("{}#{}+{N_PARTS}", scene.display(), N_PARTS * bank);
        let ([name, how], (side, more)) = (touches.bank(), touches.evaluated());
        let file = format!("{name}-{kind}-{bank}.bank");
        let program = self.program("tactile-infer", "bank --xy-step-mm 2 --theta-step-deg 15").words(how);
        let program = program.arg("--scene").arg(&scene).words(format!("--out {file}"));
        let made = Step::new(&file, program, &file).needs(&self.model).needs(&self.maps);
        let evaluate = |kind_of: &str, flags: String| {
            let name = format!("{}-{kind}-{bank}{kind_of}", touches.name());
            let program = self.program("tactile-filter", "evaluate --engines exact --actions information --touches 10");
            let program = program.words(format!("--poses off-grid --shard 1/1 --bank {file} {side} {flags}"));
            let program = program.arg("--scene").arg(&scene).words(format!("--out {name}"));
            Step::new(&name, program, &name).with_last("shard-1-of-1.json").needs(&self.maps).needs(&file)
        };
        let at = seed + more;
        let evaluations = [
            evaluate("", format!("--episodes 36 --seeds {at}")),
            evaluate("-drawn", format!("--episodes 36 --seeds {} --drawn-sensor {}", at + 10, at - 300)),
            evaluate("-strangers", format!("--episodes 48 --absent --seeds {}", at + 20)),
            evaluate(
                "-strangers-drawn",
                format!("--episodes 48 --absent --seeds {} --drawn-sensor {}", at + 30, at - 200),
            ),
        ];
        let names = evaluations.iter().map(|step| step.name.clone()).collect();
        (std::iter::once(made).chain(evaluations).collect(), names)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn networks_in_the_output_folder_are_refused_by_whatever_path() {
        let out = std::env::temp_dir().join(format!("xtask-certify-{}", std::process::id()));
        fs::create_dir_all(out.join("within")).unwrap();
        let maps = out.join("maps.safetensors");
        fs::write(&maps, "networks").unwrap();
        let args = CertifyArgs {
            maps: maps.clone(),
            model: Some(maps.clone()),
            only: Vec::new(),
            banks: 1,
            out: Some(out.join("within/..")),
        };
        let error = certify(&Workspace { root: out.clone(), target: out.clone() }, &args).unwrap_err().to_string();
        assert!(error.contains("another folder than --out"), "{error}");
        assert_eq!(fs::read_to_string(&maps).unwrap(), "networks");
        fs::remove_dir_all(&out).unwrap();
    }

    #[test]
    fn each_kind_has_scenes_of_its_own_and_each_bank_is_made_once() {
        let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..");
        for (kind, _) in KINDS {
            let scene = root.join(format!("data/scenes/maze-parts-{kind}.toml"));
            let text = fs::read_to_string(&scene).unwrap();
            let n = text.lines().find_map(|line| line.strip_prefix("n = ")).unwrap();
            assert!(n.parse::<u32>().unwrap() >= 5 * N_PARTS, "{kind}");
        }
        let workspace = Workspace { target: root.join("target"), root };
        let job = Job { workspace: &workspace, model: "model".into(), maps: "maps".into() };
        let (steps, fits) = job.steps(Touches::value_variants(), 5);
        let is_bank = |step: &&Step| step.name.ends_with(".bank");
        assert_eq!((steps.iter().filter(is_bank).count(), steps.len()), (50, 50 + 3 * 25 * 4));
        for (touches, evaluations) in fits {
            assert_eq!(evaluations.len(), 100, "{touches:?}");
            let of_fit: Vec<&Step> = steps.iter().filter(|step| evaluations.contains(&step.name)).collect();
            let seeds: BTreeSet<String> = of_fit
                .iter()
                .map(|step| {
                    let command = step.command();
                    let after = |word: &str| command.split(word).nth(1).unwrap().split(' ').next().unwrap().to_owned();
                    format!("{} {}", after("maze-parts-"), after("--seeds "))
                })
                .collect();
            // No episodes come twice.
            assert_eq!(seeds.len(), 100, "{touches:?}");
        }
    }
}
