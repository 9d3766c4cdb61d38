//! How a slot runs a case of ROS 1 nodes.

use crate::case::failure::Failure;
use crate::case::folder::CaseFolder;
use crate::engine::nodes::case;
use crate::engine::nodes::host::Host;
use crate::engine::ros1::host::RosmasterHost;
use crate::engine::task::{Answer, Engine, Task};

pub const ENGINE: Engine = Engine { name: "ros1", run };

fn run(task: &Task<'_>) -> Result<Answer, Failure> {
    case::run(task, &|folder: &CaseFolder| {
        let host = RosmasterHost::new(task.case, task.port, folder.path());
        Ok(Box::new(host) as Box<dyn Host + '_>)
    })
}
