//! A bank, and datasets whose touches are of its parts, as a user names them.

use std::path::PathBuf;
use std::str::FromStr;

/// A bank, and datasets of touches of its parts: `BANK=DIR,DIR`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TouchesOfBank {
    /// File of the bank.
    pub bank: PathBuf,
    /// Folders of the datasets, one or more.
    pub datasets: Vec<PathBuf>,
}

impl FromStr for TouchesOfBank {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected =
            || format!("expected a bank and datasets of its touches, as parts.bank=holes,holes-2, got {text:?}");
        let (bank, datasets) = text.split_once('=').ok_or_else(expected)?;
        let datasets: Vec<PathBuf> = datasets.split(',').map(PathBuf::from).collect();
        let is_named = |path: &PathBuf| !path.as_os_str().is_empty();
        let bank = PathBuf::from(bank);
        if is_named(&bank) && datasets.iter().all(is_named) { Ok(Self { bank, datasets }) } else { Err(expected()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bank_and_its_datasets_are_named_together() {
        let found: TouchesOfBank = "out/a.bank=holes,b=c".parse().unwrap();
        assert_eq!((found.bank, found.datasets), ("out/a.bank".into(), vec!["holes".into(), "b=c".into()]));
        for wrong in ["", "a", "a=", "=b", "a=b,", "a=,b"] {
            assert!(wrong.parse::<TouchesOfBank>().unwrap_err().contains("parts.bank=holes"), "{wrong}");
        }
    }
}
