//! How a slot runs a case of ROS 2 nodes.

use std::path::Path;

use crate::case::failure::Failure;
use crate::case::folder::CaseFolder;
use crate::engine::nodes::case;
use crate::engine::nodes::host::Host;
use crate::engine::ros2::host::Ros2Host;
use crate::engine::ros2::shared_memory::{FOLDER, SharedMemory};
use crate::engine::task::{Answer, Engine, Task};

pub const ENGINE: Engine = Engine { name: "ros2", run };

fn run(task: &Task<'_>) -> Result<Answer, Failure> {
    let noted = SharedMemory::note(Path::new(FOLDER));
    let answer = case::run(task, &|folder: &CaseFolder| {
        let host = Ros2Host::new(task, folder.path())?;
        Ok(Box::new(host) as Box<dyn Host + '_>)
    });
    noted.clean();
    answer
}
