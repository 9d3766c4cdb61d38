//! Whether the stack still starts up, by what its processes do and by what the graph shows.

use std::time::Duration;

use bagpipe_graph::{Node, SystemState};

use crate::processes::Starting;

/// The watch over a stack that starts up. Each question takes in the graph as it is now: one that has
/// changed restarts the time in which nobody may have worked.
pub(crate) struct Startup {
    starting: Starting,
    last: SystemState,
}

impl Startup {
    /// Of the processes below one.
    pub(crate) fn below(root: Option<u32>) -> Startup {
        Startup { starting: Starting::below(root), last: SystemState::default() }
    }

    /// Whether nobody has worked for a while.
    pub(crate) fn is_over(&mut self, state: &SystemState) -> bool {
        let changed = self.has_changed(state);
        self.starting.is_over(changed)
    }

    /// The same, also where somebody has begun to work again since. A graph that did not answer has
    /// not changed.
    pub(crate) fn rests(&mut self, state: Option<&SystemState>) -> bool {
        let changed = state.is_some_and(|state| self.has_changed(state));
        self.starting.rests(changed)
    }

    /// Whether it is known that nobody is still to come: nobody works, nor sleeps until it goes on, and
    /// every node does its work.
    pub(crate) fn is_complete(&mut self, state: &SystemState, node: &dyn Node) -> bool {
        self.rests(Some(state))
            && self.starting.sees_nobody_sleep()
            && node.all_spin(&self.starting.leaves())
    }

    /// For how long in all somebody could have worked and had no processor.
    pub(crate) fn starved(&self) -> Duration {
        self.starting.starved()
    }

    fn has_changed(&mut self, state: &SystemState) -> bool {
        let changed = *state != self.last;
        if changed {
            self.last.clone_from(state);
        }
        changed
    }
}
