//! How a slot runs a case of ROS 1 nodes: their input as a recording, in memory or on disk, or the
//! worker's simulator.

use std::cell::{Cell, RefCell};
use std::fs::File;
use std::time::Instant;

use crate::case::failure::Failure;
use crate::case::folder::CaseFolder;
use crate::engine::on_disk::{OnDisk, failed};
use crate::engine::ros1::feed::{receive, receive_on_disk};
use crate::engine::ros1::outcome::{Outcome, Timings};
use crate::engine::ros1::{Input, Runner};
use crate::engine::task::{Answer, Engine, Recording, Task};
use crate::stack::{Ros, Surroundings};

pub const ENGINE: Engine = Engine { name: "ros1", run };

fn run(task: &Task<'_>) -> Result<Answer, Failure> {
    let (outcome, recording) = play(task)?;
    let answer = Answer::of(&outcome)?;
    Ok(Answer { recording: Some(recording), ledger: Some(outcome.ledger), ..answer })
}

fn play(task: &Task<'_>) -> Result<(Outcome, Recording), Failure> {
    let begun = Instant::now();
    let (budget, stopping) = (task.memory_budget, || task.stopping());
    if let Some(simulator) = &task.case.simulator {
        let (outcome, bytes) = run_on(task, &Input::Simulator(simulator), begun)?;
        return Ok((outcome, Recording::InMemory(bytes)));
    }
    if let Some(disk) = task.on_disk {
        let until: (Instant, &dyn Fn() -> bool) = (task.deadline, &stopping);
        let (header, opened) = receive_on_disk(&mut task.link.borrow_mut(), budget, until, disk)?;
        let path = disk.recording()?;
        let input = Input::Recording(&header, &*opened.recording);
        let (outcome, _) = run_on(task, &input, begun)?;
        disk.settle(&path)?;
        let file = File::open(&path).map_err(|error| failed(&path, &error))?;
        let length = file.metadata().map_err(|error| failed(&path, &error))?.len();
        return Ok((outcome, Recording::OnDisk(file, length)));
    }
    let (header, opened) = receive(&mut task.link.borrow_mut(), budget, task.deadline, &stopping)?;
    let input = Input::Recording(&header, &*opened.recording);
    let (outcome, bytes) = run_on(task, &input, begun)?;
    Ok((outcome, Recording::InMemory(bytes)))
}

/// Runs a case whose input is there; the recording, where it is kept in memory.
fn run_on(
    task: &Task<'_>,
    input: &Input<'_>,
    begun: Instant,
) -> Result<(Outcome, Vec<u8>), Failure> {
    let timings = Timings { assemble: begun.elapsed().as_secs_f64(), ..Timings::default() };
    let folder = CaseFolder::make(task.slot, task.folder)
        .map_err(|message| Failure::new("Internal", message))?;
    let master_uri = format!("http://127.0.0.1:{}", task.port);
    let runner = Runner {
        port: task.port,
        record_to: task.on_disk.map(OnDisk::recording).transpose()?,
        case: task.case,
        master_uri: &master_uri,
        surroundings: Surroundings {
            environment: &task.case.stack.environment,
            ros: Some(Ros { master_uri: &master_uri, folder: folder.path() }),
            label: task.label(),
        },
        deadline: task.deadline,
        stop: task.stop,
        link: task.link,
        meter: task.meter,
        children: task.children,
        course: RefCell::default(),
        roll: RefCell::default(),
        glanced: Cell::new(None),
    };
    runner.run(input, timings)
}
