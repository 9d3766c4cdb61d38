//! How a slot runs a case of nodes: their input as a recording, in memory or on disk, or the
//! worker's simulator.

use std::cell::{Cell, RefCell};
use std::fs::File;
use std::time::Instant;

use crate::case::failure::Failure;
use crate::case::folder::CaseFolder;
use crate::engine::nodes::feed::{receive, receive_on_disk};
use crate::engine::nodes::host::Host;
use crate::engine::nodes::outcome::{Outcome, Timings};
use crate::engine::nodes::runner::{Input, Runner};
use crate::engine::on_disk::{OnDisk, failed};
use crate::engine::task::{Answer, Recording, Task};
use crate::stack::Surroundings;
use crate::stack::processes::Spared;

/// Makes a middleware's host for a case, which may write into the folder.
pub type MakeHost<'a> = &'a dyn Fn(&CaseFolder) -> Result<Box<dyn Host + 'a>, Failure>;

/// Runs a case; when it returns, nothing that it started is left.
pub fn run(task: &Task<'_>, host: MakeHost<'_>) -> Result<Answer, Failure> {
    let (outcome, recording) = play(task, host)?;
    let answer = Answer::of(&outcome)?;
    Ok(Answer { recording: Some(recording), ledger: Some(outcome.ledger), ..answer })
}

fn play(task: &Task<'_>, host: MakeHost<'_>) -> Result<(Outcome, Recording), Failure> {
    let begun = Instant::now();
    let (budget, stopping) = (task.memory_budget, || task.stopping());
    if let Some(simulator) = &task.case.simulator {
        let (outcome, bytes) = run_on(task, host, &Input::Simulator(simulator), begun)?;
        return Ok((outcome, Recording::InMemory(bytes)));
    }
    if let Some(disk) = task.on_disk {
        let until: (Instant, &dyn Fn() -> bool) = (task.deadline, &stopping);
        let (header, opened) = receive_on_disk(&mut task.link.borrow_mut(), budget, until, disk)?;
        let path = disk.recording()?;
        let input = Input::Recording(&header, &*opened.recording);
        let (outcome, _) = run_on(task, host, &input, begun)?;
        disk.settle(&path)?;
        let file = File::open(&path).map_err(|error| failed(&path, &error))?;
        let length = file.metadata().map_err(|error| failed(&path, &error))?.len();
        return Ok((outcome, Recording::OnDisk(file, length)));
    }
    let (header, opened) = receive(&mut task.link.borrow_mut(), budget, task.deadline, &stopping)?;
    let input = Input::Recording(&header, &*opened.recording);
    let (outcome, bytes) = run_on(task, host, &input, begun)?;
    Ok((outcome, Recording::InMemory(bytes)))
}

/// Runs a case whose input is there; the recording, where it is kept in memory.
fn run_on(
    task: &Task<'_>,
    host: MakeHost<'_>,
    input: &Input<'_>,
    begun: Instant,
) -> Result<(Outcome, Vec<u8>), Failure> {
    let timings = Timings { assemble: begun.elapsed().as_secs_f64(), ..Timings::default() };
    let folder = CaseFolder::make(task.slot, task.folder)
        .map_err(|message| Failure::new("Internal", message))?;
    let host = host(&folder)?;
    let runner = Runner {
        host: &*host,
        record_to: task.on_disk.map(OnDisk::recording).transpose()?,
        case: task.case,
        surroundings: Surroundings {
            environment: &task.case.stack.environment,
            variables: host.variables(),
            label: task.label(),
        },
        deadline: task.deadline,
        stop: task.stop,
        link: task.link,
        meter: task.meter,
        children: task.children,
        spared: Spared::default(),
        course: RefCell::default(),
        roll: RefCell::default(),
        before: RefCell::default(),
        unseen: RefCell::default(),
        glanced: Cell::new(None),
    };
    runner.run(input, timings)
}
