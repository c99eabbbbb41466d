//! Real presses named by a model: banks of simulated parts, touched by real sensors.
//!
//! Only programs are run: what a row says is what they printed. No real press is of a hole, so all of it is peg against
//! peg.

mod balls;
mod bench;
mod cuboid;
mod digit;
mod light;
mod named;
mod page;
mod twins;

use std::fs;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::workspace::Workspace;
use bench::Bench;
use named::{Counts, Named};
use twins::Twins;

/// What is real and what is not: the first thing that the page says.
const SCOPE: &str = "Real: every press that is named here, the sensor's frame at rest, and for the balls the light, \
                     fitted to other presses than those that are tested. Simulated: all views of the bank, of 20 to 23 parts \
                     of which one or none was pressed, and everything that the model was trained on. Raised parts are \
                     named among raised parts: no public real image of a hole, a letter or a connector is known.";

/// What `cargo xtask real` takes.
#[derive(Args)]
pub struct RealArgs {
    /// Folder of the real images; what is missing there is skipped.
    #[arg(long, default_value = "../shared/real-gelsight")]
    real: PathBuf,
    /// Folder for the page, the JSON and all that is made on the way; must be empty [default: real in the build folder].
    #[arg(long)]
    out: Option<PathBuf>,
    /// The model that names the presses [default: the shipped one].
    #[arg(long)]
    model: Option<PathBuf>,
    /// Networks that draw each press and verify by maps [default: none].
    #[arg(long)]
    maps: Option<PathBuf>,
}

/// What came of one set of real presses.
struct Set {
    title: &'static str,
    /// Address of the repository that the images are from, and their licence.
    source: [&'static str; 2],
    /// What was done.
    about: String,
    /// Each kind of episode, by its name.
    named: Vec<(&'static str, Vec<Named>)>,
    /// Presses against their simulated twins, where there are any.
    twins: Option<Twins>,
}

/// Builds the programs, names every real press and writes the report. A wrong name is a finding, not a failure of this
/// program.
pub fn real(workspace: &Workspace, args: &RealArgs) -> Result<()> {
    let Ok(real) = args.real.canonicalize() else {
        println!("skipped: {} is not there", args.real.display());
        return Ok(());
    };
    let model = args.model.clone().unwrap_or_else(|| workspace.shipped_model());
    let model = model.canonicalize().map_err(Error::io(&model))?;
    let maps = args.maps.clone().map(|path| path.canonicalize().map_err(Error::io(&path))).transpose()?;
    let out = workspace.folder(args.out.as_deref(), &workspace.target.join("real"))?;
    if fs::read_dir(&out).map_err(Error::io(&out))?.next().is_some() {
        return Err(Error::invalid(out.display().to_string(), "an empty folder", "files of an earlier run"));
    }
    workspace.build()?;
    let bench = Bench { workspace, real, model, maps, out };
    let sets = [balls::FOTS.name(&bench)?, balls::GELSLAM.name(&bench)?, cuboid::name(&bench)?, digit::name(&bench)?];
    let sets: Vec<Set> = sets.into_iter().flatten().collect();
    for set in &sets {
        set.lines().iter().for_each(|[what, measured]| println!("{}, {what}: {measured}", set.title));
    }
    let (json, page) = (bench.out.join("real.json"), bench.out.join("real.html"));
    fs::write(&json, format!("{:#}\n", summary(&sets, &bench)?)).map_err(Error::io(&json))?;
    fs::write(&page, page::draw(&sets, &bench)).map_err(Error::io(&page))?;
    println!("{SCOPE}");
    println!("report: {}", page.display());
    Ok(())
}

impl Set {
    /// What was measured, in words: what, and how it came out.
    fn lines(&self) -> Vec<[String; 2]> {
        let named = self.named.iter().map(|(kind, named)| [(*kind).to_owned(), Counts::of(named).to_string()]);
        named.chain(self.twins.iter().flat_map(Twins::lines)).collect()
    }
}

fn summary(sets: &[Set], bench: &Bench) -> Result<Value> {
    let kind = |(kind, named): &(&str, Vec<Named>)| {
        let episodes: Vec<Value> = named.iter().map(Named::json).collect();
        json!({ "kind": kind, "counts": Counts::of(named).json(), "episodes": episodes })
    };
    let set = |set: &Set| {
        let [repository, licence] = set.source;
        json!({
            "set": set.title, "repository": repository, "licence": licence,
            "named": set.named.iter().map(kind).collect::<Vec<_>>(), "twins": set.twins.as_ref().map(Twins::json),
        })
    };
    Ok(json!({
        "schema": "tactile-filter/real/1", "scope": SCOPE, "model": bench.model_name()?,
        "sets": sets.iter().map(set).collect::<Vec<_>>(),
    }))
}
