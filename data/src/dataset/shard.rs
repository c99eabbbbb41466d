//! One part of a job that is cut into equal, contiguous parts, each run by itself.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Shard `number` of `count`, `number` from 1, written `2/5`.
///
/// The shards of one count share out any number of items: each item belongs to exactly one shard, a shard's items
/// are consecutive, and no shard has two more than another.
///
/// ```
/// # fn main() -> tactile_data::Result<()> {
/// let shard: tactile_data::dataset::shard::Shard = "2/5".parse()?;
/// assert_eq!((shard.index(), shard.count(), shard.range(12)), (1, 5, 2..4));
/// assert_eq!(shard.to_string(), "2/5");
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Shard {
    index: usize,
    count: usize,
}

/// Which shard of which plan a dataset holds; `fragment` in its `meta.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fragment {
    /// The shard.
    pub shard: Shard,
    /// Touches of the whole plan.
    pub n_planned: usize,
    /// SHA-256 of the whole plan, 64 hex digits: what is touched, where, in which order.
    pub plan_sha256: String,
}

/// How a shard is written, for errors.
const FORM: &str = "i/n with i in 1..=n such as 2/5, or env";

impl Shard {
    /// Shard `number` of `count`. Fails unless `1 <= number <= count`.
    pub fn new(number: usize, count: usize) -> Result<Self> {
        if !(1..=count).contains(&number) {
            return Err(Error::invalid("shard", FORM, format!("{number}/{count}")));
        }
        Ok(Self { index: number - 1, count })
    }

    /// The shard that a scheduler gave this task: what `env` means.
    pub fn from_env() -> Result<Self> {
        Self::from_variables(|name| std::env::var(name).ok())
    }

    /// The shard that environment variables state; `variable` gives the value of a name.
    ///
    /// A Slurm job array sets `SLURM_ARRAY_TASK_ID`, `_COUNT`, `_MIN`, `_MAX` and `_STEP`; the array may begin
    /// anywhere and take steps, but must have no gaps, because its count would then say too little. A Kubernetes
    /// indexed job sets `JOB_COMPLETION_INDEX`, from 0; its manifest has to set `JOB_COMPLETION_COUNT` to the
    /// number of completions.
    pub fn from_variables(variable: impl Fn(&str) -> Option<String>) -> Result<Self> {
        let number = |name: &str| -> Result<usize> {
            let text = variable(name).unwrap_or_else(|| "none".into());
            text.trim().parse().map_err(|_| Error::invalid(name, "a whole number", text))
        };
        let optional = |name: &str, default| if variable(name).is_some() { number(name) } else { Ok(default) };
        if variable("SLURM_ARRAY_TASK_ID").is_some() {
            let (id, count) = (number("SLURM_ARRAY_TASK_ID")?, number("SLURM_ARRAY_TASK_COUNT")?);
            let (first, step) = (number("SLURM_ARRAY_TASK_MIN")?, optional("SLURM_ARRAY_TASK_STEP", 1)?.max(1));
            let last = optional("SLURM_ARRAY_TASK_MAX", id)?;
            let place = |id: usize| id.checked_sub(first).filter(|gap| gap % step == 0).map(|gap| gap / step);
            let whole = variable("SLURM_ARRAY_TASK_MAX").is_none() || place(last).map(|at| at + 1) == Some(count);
            return match place(id).filter(|at| *at < count && whole) {
                Some(index) => Ok(Self { index, count }),
                None => {
                    let got = format!("task {id} of {count} from {first} to {last} by {step}");
                    Err(Error::invalid("SLURM_ARRAY_TASK_ID", "an array without gaps, such as 1-4", got))
                }
            };
        }
        if variable("JOB_COMPLETION_INDEX").is_some() {
            let (index, count) = (number("JOB_COMPLETION_INDEX")?, number("JOB_COMPLETION_COUNT")?);
            if index >= count {
                return Err(Error::invalid("JOB_COMPLETION_INDEX", format!("below {count}"), index.to_string()));
            }
            return Ok(Self { index, count });
        }
        let expected = "SLURM_ARRAY_TASK_ID, or JOB_COMPLETION_INDEX and JOB_COMPLETION_COUNT, in the environment";
        Err(Error::invalid("shard env", expected, "neither"))
    }

    /// Which shard, from 0: one less than its number.
    pub fn index(self) -> usize {
        self.index
    }

    /// Shards in all, at least 1.
    pub fn count(self) -> usize {
        self.count
    }

    /// Which of `n_items` are this shard's; empty only where there are fewer items than shards.
    pub fn range(self, n_items: usize) -> Range<usize> {
        // In u128, where no product of two sizes is too large; the quotient is at most n_items again.
        let cut = |at: usize| (at as u128 * n_items as u128 / self.count as u128) as usize;
        cut(self.index)..cut(self.index + 1)
    }

    /// Whether item `i` of `n_items` is this shard's.
    pub fn owns(self, i: usize, n_items: usize) -> bool {
        self.range(n_items).contains(&i)
    }

    /// All shards of a count, in order; none where it is 0.
    pub fn all(count: usize) -> impl Iterator<Item = Self> {
        (0..count).map(move |index| Self { index, count })
    }
}

/// `2/5`, or `env` for [`Shard::from_env`]: nothing else is read from the environment.
impl FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        if text == "env" { Self::from_env() } else { Self::try_from(text.to_owned()) }
    }
}

/// `2/5` only, as a file has it.
impl TryFrom<String> for Shard {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        let shard = numbers.and_then(|(number, count)| Self::new(number, count).ok());
        shard.ok_or_else(|| Error::invalid("shard", FORM, text))
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        shard.to_string()
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.count)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The shard that some variables state, or its error.
    fn of(variables: &[(&str, &str)]) -> std::result::Result<String, String> {
        let value = |name: &str| variables.iter().find(|(key, _)| *key == name).map(|(_, value)| value.to_string());
        Shard::from_variables(value).map(|shard| shard.to_string()).map_err(|error| error.to_string())
    }

    fn slurm(id: &str, count: &str, first: &str, last: &str, step: &str) -> std::result::Result<String, String> {
        let names = ["ID", "COUNT", "MIN", "MAX", "STEP"].map(|name| format!("SLURM_ARRAY_TASK_{name}"));
        let pairs: Vec<_> = names.iter().map(String::as_str).zip([id, count, first, last, step]).collect();
        of(&pairs)
    }

    proptest! {
        #[test]
        fn each_item_belongs_to_one_shard_and_the_shares_are_even(n_items in 0_usize..500, count in 1_usize..40) {
            let owners = |i| Shard::all(count).filter(|shard| shard.owns(i, n_items)).count();
            prop_assert!((0..n_items).all(|i| owners(i) == 1));
            let shares: Vec<_> = Shard::all(count).map(|shard| shard.range(n_items).len()).collect();
            prop_assert!(shares.iter().all(|share| (n_items / count..=n_items.div_ceil(count)).contains(share)));
        }

        #[test]
        fn a_shard_is_read_as_it_is_written(count in 1_usize..1000, at in 0_usize..1000) {
            let shard = Shard::new(1 + at % count, count).unwrap();
            prop_assert_eq!(shard.to_string().parse::<Shard>().unwrap(), shard);
            prop_assert_eq!(serde_json::to_value(shard).unwrap(), shard.to_string());
        }
    }

    #[test]
    fn a_file_states_a_number_and_a_count() {
        assert_eq!(serde_json::from_str::<Shard>("\"2/5\"").unwrap(), Shard::new(2, 5).unwrap());
        assert!(serde_json::from_str::<Shard>("\"env\"").is_err());
    }

    #[test]
    fn ranges_do_not_overflow() {
        assert_eq!(Shard::new(3, 3).unwrap().range(usize::MAX).end, usize::MAX);
    }

    #[test]
    fn what_is_no_shard_is_refused_in_one_line() {
        for bad in ["0/5", "6/5", "1/0", "2", "2/", "/5", "a/b", "-1/5", "2/5/6", "", " 2/5", "ENV"] {
            let message = bad.parse::<Shard>().unwrap_err().to_string();
            assert_eq!(message, format!("shard: expected {FORM}, got {bad}"));
        }
    }

    #[test]
    fn a_slurm_array_counts_from_its_first_task() {
        assert_eq!(slurm("2", "5", "1", "5", "1").unwrap(), "2/5");
        assert_eq!(slurm("0", "4", "0", "3", "1").unwrap(), "1/4");
        assert_eq!(slurm("7", "3", "3", "7", "2").unwrap(), "3/3");
        let [id, count, first] = ["ID", "COUNT", "MIN"].map(|name| format!("SLURM_ARRAY_TASK_{name}"));
        assert_eq!(of(&[(&id, "2"), (&count, "5"), (&first, "1")]).unwrap(), "2/5");
        assert!(of(&[(&id, "2"), (&count, "5")]).unwrap_err().contains("SLURM_ARRAY_TASK_MIN: expected a whole"));
    }

    /// Task 1 of `--array=1,3` must not take itself for the first of two neighbours.
    #[test]
    fn a_slurm_array_with_gaps_is_refused_by_each_task() {
        for id in ["1", "3"] {
            assert!(slurm(id, "2", "1", "3", "1").unwrap_err().contains("an array without gaps"));
        }
        assert!(slurm("0", "2", "1", "2", "1").is_err());
        assert!(slurm("x", "2", "1", "2", "1").unwrap_err().starts_with("SLURM_ARRAY_TASK_ID: expected a whole"));
    }

    #[test]
    fn an_indexed_job_counts_from_zero_and_states_its_count() {
        assert_eq!(of(&[("JOB_COMPLETION_INDEX", "0"), ("JOB_COMPLETION_COUNT", "3")]).unwrap(), "1/3");
        assert!(of(&[("JOB_COMPLETION_INDEX", "3"), ("JOB_COMPLETION_COUNT", "3")]).unwrap_err().contains("below 3"));
        assert!(of(&[("JOB_COMPLETION_INDEX", "0")]).unwrap_err().starts_with("JOB_COMPLETION_COUNT: expected"));
        assert!(of(&[]).unwrap_err().contains("neither"));
    }
}
