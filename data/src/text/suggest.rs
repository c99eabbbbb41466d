//! Names that were nearly right: "did you mean".

use crate::error::{Error, Result};

/// The candidate that `name` was probably meant to be; `None` where none is close.
pub fn closest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // One wrong, missing, extra or swapped letter in three.
    let most = (name.chars().count() / 3).max(1);
    let distance = |candidate: &str| strsim::damerau_levenshtein(&name.to_lowercase(), &candidate.to_lowercase());
    let by_distance = candidates.into_iter().map(|candidate| (distance(candidate), candidate));
    by_distance.filter(|(distance, _)| *distance <= most).min_by_key(|(distance, _)| *distance).map(|(_, name)| name)
}

/// `name` as an error shows what it got, with the closest candidate: `gelsigth (did you mean gelsight?)`.
pub fn with_closest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    closest(name, candidates).map_or_else(|| name.to_owned(), |closest| format!("{name} (did you mean {closest}?)"))
}

/// The one of `all` that has a name.
///
/// # Errors
/// None: the names there are, and the closest.
pub fn named<T: Copy>(what: &str, name: &str, all: &[T], name_of: impl Fn(T) -> &'static str) -> Result<T> {
    let names = || all.iter().map(|one| name_of(*one));
    let found = names().position(|known| known == name).and_then(|at| all.get(at).copied());
    found.ok_or_else(|| Error::invalid(what, names().collect::<Vec<_>>().join(", "), with_closest(name, names())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_is_recognised_and_another_word_is_not() {
        let names = ["alphabet-small", "alphabet-large", "maze", "usb-a"];
        for (slip, meant) in
            [("alphabet-smal", "alphabet-small"), ("Maze", "maze"), ("maez", "maze"), ("usba", "usb-a")]
        {
            assert_eq!(closest(slip, names), Some(meant), "{slip}");
        }
        assert_eq!(closest("connectors", names), None);
        assert_eq!(with_closest("maz", names), "maz (did you mean maze?)");
        assert_eq!(with_closest("nowhere", names), "nowhere");
    }
}
