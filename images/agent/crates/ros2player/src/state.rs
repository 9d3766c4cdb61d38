//! The states of nodes with a life cycle (`lifecycle_msgs`), asked one step at a time.

use crate::control::{Answer, Request, Verb};
use crate::layout::STATES;
use crate::{Player, PlayerError};

/// How far the question for a node's state is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Nobody serves it: there is no such node by now, or it has no life cycle.
    Nobody,
    /// It was asked by this call.
    Now,
    /// It was asked by an earlier call, and has not answered by now.
    Before,
    /// The answer to what was asked last: a number of `lifecycle_msgs/msg/State`.
    Answered(u8),
}

impl Player {
    /// Takes on by a step the question for the state of the node `name`, such as `/ns/planner`: it is
    /// asked by one call, and answered by a later one. `number` is the node's from the first call on.
    /// Who is answered is known to the node, with all that was subscribed to before the first call:
    /// DDS makes endpoints known in their order.
    ///
    /// # Errors
    /// `lifecycle_msgs` is not installed, there are 64 nodes, the player has no librcl, or the
    /// deadline is past.
    pub fn ask_state(&self, number: usize, name: &str) -> Result<Asked, PlayerError> {
        let service = format!("{name}/get_state");
        if number >= STATES {
            return Err(PlayerError::TooMany { topic: service, most: STATES });
        }
        let request = Request::new(Verb::State).number(number as u32).text(name);
        let about = (service.as_str(), "lifecycle_msgs/srv/GetState", "lifecycle_msgs");
        read(&mut self.ask(&format!("call {service}"), &request, Some(about))?)
    }
}

/// Reads an answer, after its status.
fn read(from: &mut Answer) -> Result<Asked, PlayerError> {
    let (asked, state) = (from.number()?, from.number()?);
    match (asked, u8::try_from(state)) {
        (0, _) => Ok(Asked::Nobody),
        (1, _) => Ok(Asked::Now),
        (2, _) => Ok(Asked::Before),
        (3, Ok(state)) => Ok(Asked::Answered(state)),
        _ => {
            Err(PlayerError::Answer(format!("{asked} with {state} says of no state how far it is")))
        }
    }
}
