//! What runs a case's stack, one folder for each engine.

pub(crate) mod exec;
pub(crate) mod maps;
pub(crate) mod nodes;
pub(crate) mod on_disk;
pub(crate) mod ros1;
pub(crate) mod ros2;
pub(crate) mod task;

use crate::engine::task::Engine;

/// All of them; the first runs a case that names none.
const ENGINES: &[Engine] = &[ros1::entry::ENGINE, exec::entry::ENGINE, ros2::entry::ENGINE];

/// The engine that a case names; the error is a sentence.
pub fn chosen(name: Option<&str>) -> Result<&'static Engine, String> {
    let Some(name) = name else { return Ok(&ENGINES[0]) };
    ENGINES.iter().find(|engine| engine.name == name).ok_or_else(|| {
        let known: Vec<_> = ENGINES.iter().map(|engine| engine.name).collect();
        let known = known.join(" or ");
        format!(
            "the case in HELLO cannot be understood: error while decoding value: engine is \
             {name:?}, not {known}"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_is_run_by_the_engine_that_it_names_or_else_by_the_first() {
        assert_eq!(chosen(Some("exec")).map(|engine| engine.name), Ok("exec"));
        assert_eq!(chosen(None).map(|engine| engine.name), Ok("ros1"));
        assert_eq!(chosen(Some("ros2")).map(|engine| engine.name), Ok("ros2"));
        let other = chosen(Some("ros3")).map(|engine| engine.name).unwrap_err();
        assert!(other.ends_with("engine is \"ros3\", not ros1 or exec or ros2"), "{other}");
    }
}
