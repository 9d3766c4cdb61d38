//! What an answer says that is none: its status, as `player/answer.h` lists them.

use crate::PlayerError;
use crate::control::Answer;

pub(crate) const STATUS_DONE: u32 = 0;
const STATUS_LIBRARY: u32 = 1;
const STATUS_SYMBOL: u32 = 2;
const STATUS_PACKAGE: u32 = 3;
const STATUS_TYPE: u32 = 4;
const STATUS_CALL: u32 = 5;

/// The error of an answer that says so.
pub(crate) fn failure(
    status: u32,
    answer: &mut Answer,
    (topic, datatype, package): (&str, &str, &str),
) -> Result<PlayerError, PlayerError> {
    let first = answer.text()?;
    let topic = topic.to_owned();
    Ok(match status {
        STATUS_LIBRARY => PlayerError::NoRos(first),
        STATUS_SYMBOL => PlayerError::Symbol(first),
        STATUS_PACKAGE => {
            let package = package.to_owned();
            PlayerError::Package { topic, package, library: first, reason: answer.text()? }
        }
        STATUS_TYPE => PlayerError::Type { topic, datatype: datatype.to_owned(), library: first },
        STATUS_CALL => of_call(first, answer.number()?.cast_signed(), answer.text()?),
        _ => PlayerError::Answer(first),
    })
}

/// That a call has failed. A name that it refuses is not for want of room.
fn of_call(function: String, code: i32, reason: String) -> PlayerError {
    const RCL_RET_ERROR: i32 = 1;
    match (function.as_str(), code) {
        ("rcl_init" | "rcl_node_init", RCL_RET_ERROR) => {
            PlayerError::Join { function, code, reason, errors: Vec::new() }
        }
        _ => PlayerError::Call { function, code, reason },
    }
}
