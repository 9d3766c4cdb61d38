//! How a slot runs a case of a program.

use crate::case::failure::Failure;
use crate::engine::exec::ExecRunner;
use crate::engine::task::{Answer, Engine, Task};
use crate::stack::{Surroundings, Variables};

pub const ENGINE: Engine = Engine { name: "exec", run };

fn run(task: &Task<'_>) -> Result<Answer, Failure> {
    let runner = ExecRunner {
        case: task.case,
        session: task.session,
        described: task.described.clone(),
        surroundings: Surroundings {
            environment: &task.case.stack.environment,
            variables: Variables::default(),
            label: task.label(),
        },
        deadline: task.deadline,
        stop: task.stop,
        link: task.link,
        children: task.children,
    };
    // Its files went out as they came; their description comes last.
    Answer::of(&runner.run()?)
}
