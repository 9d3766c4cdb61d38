//! What ROS 1's nodes need around them: a master with their parameters.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bagpipe_graph::Middleware;
use bagpipe_log::RecordingFormat;
use bagpipe_ros1::{Ros1, RosError, Rosmaster};
use bagpipe_rosbag::{Compression, WriterOptions};
use bagpipe_wire::Abort;
use rustix::process::Pid;

use crate::case::failure::Failure;
use crate::case::{Case, Master};
use crate::engine::nodes::host::{Ending, Host, Occasion};
use crate::engine::nodes::runner::silent;
use crate::engine::ros1::met::Met;
use crate::engine::ros1::{parameters, roll, rosmaster};
use crate::stack::end::StackEnd;
use crate::stack::nodes::{Found, Known};
use crate::stack::processes::{Children, Ended};
use crate::stack::witness::Watcher;
use crate::stack::{Program, Variables};

/// The master of a case: the image's rosmaster, or one that is served here.
pub struct RosmasterHost<'a> {
    case: &'a Case,
    port: u16,
    uri: String,
    /// Where ROS may write.
    folder: PathBuf,
    program: RefCell<Option<Program>>,
    served: RefCell<Option<Rosmaster>>,
    met: Met,
}

impl<'a> RosmasterHost<'a> {
    pub fn new(case: &'a Case, port: u16, folder: &Path) -> Self {
        let uri = format!("http://127.0.0.1:{port}");
        let (program, served) = (RefCell::default(), RefCell::default());
        Self { case, port, uri, folder: folder.to_owned(), program, served, met: Met::default() }
    }

    fn pid(&self) -> Option<Pid> {
        self.program.borrow().as_ref().map(|program| program.pid)
    }
}

impl Host for RosmasterHost<'_> {
    fn variables(&self) -> Variables {
        let set = vec![
            ("ROS_MASTER_URI", self.uri.clone().into()),
            ("ROS_IP", "127.0.0.1".into()),
            ("ROS_HOME", self.folder.clone().into()),
            ("ROS_LOG_DIR", self.folder.join("log").into()),
        ];
        Variables { set, removed: &["ROS_HOSTNAME"] }
    }

    fn command(&self) -> Result<Vec<String>, Failure> {
        Ok(self.case.stack.command.clone())
    }

    fn start(&self, occasion: &Occasion<'_>) -> Result<(), Failure> {
        let Occasion { surroundings, children, deadline, interrupted } = *occasion;
        if self.case.stack.master == Master::Agent {
            let (served, master) = rosmaster::serve(self.port, &self.uri, self.met.note())?;
            self.served.replace(Some(served));
            return parameters::set(&master, &self.case.stack.parameters)
                .map_err(Failure::protocol);
        }
        let program = rosmaster::start(surroundings, self.port, &mut children.borrow_mut())?;
        let mut place = self.program.borrow_mut();
        let program = place.insert(program);
        let master = rosmaster::await_answer(
            program,
            &self.uri,
            &mut children.borrow_mut(),
            deadline,
            &|| interrupted().map(silent),
        )?;
        parameters::set(&master, &self.case.stack.parameters).map_err(Failure::protocol)
    }

    fn watch_by(&self, watcher: Watcher) {
        self.met.watch_by(watcher);
    }

    fn meet(&self, _: &Occasion<'_>) -> Result<Arc<dyn Middleware>, Failure> {
        Ok(Arc::new(Ros1 { master_uri: self.uri.clone() }))
    }

    fn processes(&self) -> Vec<Pid> {
        self.pid().into_iter().collect()
    }

    fn record_as(&self) -> Arc<dyn RecordingFormat> {
        Arc::new(WriterOptions::with_compression(Compression::Lz4))
    }

    fn use_sim_time(&self) -> bool {
        self.case.use_sim_time()
    }

    fn roll(&self) -> Result<Vec<Known>, Failure> {
        let mut roll = roll::roll(&self.uri).map_err(|error| unknown(&error))?;
        self.met.name_processes(&mut roll);
        Ok(roll)
    }

    /// None where the image's rosmaster serves: it notes no socket.
    fn met(&self) -> Vec<Known> {
        self.met.take()
    }

    fn note_stayed(&self, known: &mut [Known]) -> Result<(), Failure> {
        roll::note_stayed(&self.uri, known).map_err(|error| unknown(&error))
    }

    fn look(&self, known: &[Known]) -> Result<Vec<Found>, Failure> {
        roll::look(&self.uri, known).map_err(|error| unknown(&error))
    }

    fn ended(&self, children: &mut Children) -> Option<Ended> {
        children.ended(self.pid()?)
    }

    fn take_program(&self) -> Option<Program> {
        self.program.borrow_mut().take()
    }

    /// Without a master it can't be known which nodes were there in the end.
    fn gone(&self, ending: Ending) -> Abort {
        let Ending { ended, stderr } = ending;
        let how = ended.map(|ended| ended.to_string()).unwrap_or_default();
        let message = format!(
            "the rosmaster ended with {how} during the case, so which nodes were there in the end \
             can't be known"
        );
        Abort {
            reason: "RosMasterFailed".to_owned(),
            message,
            exit_status: ended.and_then(|ended| ended.exit_status),
            signal: ended.and_then(|ended| ended.signal),
            stderr,
            ..Abort::default()
        }
    }

    fn explain(&self, mut abort: Abort, stack: Option<StackEnd>, ending: Ending) -> Abort {
        let Ending { ended, stderr } = ending;
        if let Some(ended) = ended
            && abort.reason != "RosMasterNotFound"
        {
            // Whatever went wrong after that went wrong because of it.
            if abort.reason != "RosMasterFailed" {
                let message = format!("the rosmaster ended with {ended} during the case");
                abort.message = format!("{message}; then: {}", abort.message);
                abort.reason = "RosMasterFailed".to_owned();
            }
            let Ended { exit_status, signal } = ended;
            return Abort { exit_status, signal, stderr, ..abort };
        }
        let crashed = stack.as_ref().and_then(StackEnd::crash).is_some();
        if abort.reason.starts_with("RosMaster") && !crashed {
            return Abort { stderr, ..abort };
        }
        match stack {
            Some(stack) => stack.explain(abort),
            None => abort,
        }
    }
}

/// A node that nobody looked at may have ended unnoticed.
fn unknown(error: &RosError) -> Failure {
    let what = format!("which nodes were there during the case can't be known: {error}");
    Failure::new("RosMasterFailed", what)
}
