//! Starting programs of the user's image for one case.

use std::collections::BTreeMap;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use rustix::process::Pid;

use crate::command::{ENTRYPOINT, NotRunnable, not_started, prepare};
use crate::processes::Children;
use crate::tail::Tail;

/// A started program, its output followed.
#[derive(Debug)]
pub struct Program {
    pub pid: Pid,
    stdout: Option<Tail>,
    stderr: Option<Tail>,
}

/// What programs of a case have in common.
#[derive(Debug)]
pub struct Surroundings<'a> {
    /// The case's own variables.
    pub environment: &'a BTreeMap<String, String>,
    pub master_uri: &'a str,
    /// Where ROS may write.
    pub folder: &'a Path,
    /// What goes before each line of output: slot and case.
    pub label: String,
}

impl Surroundings<'_> {
    /// The PATH that the program is searched in.
    pub fn path(&self) -> String {
        let inherited = || std::env::var("PATH").unwrap_or_default();
        self.environment.get("PATH").cloned().unwrap_or_else(inherited)
    }

    /// True when a ROS environment is set up already.
    pub fn has_ros(&self) -> bool {
        ["ROS_PACKAGE_PATH", "ROS_ROOT"]
            .iter()
            .any(|name| self.environment.contains_key(*name) || std::env::var_os(name).is_some())
    }

    /// Starts the command in a process group of its own.
    pub fn start(
        &self,
        command: &[String],
        name: &str,
        children: &mut Children,
    ) -> Result<Program, NotRunnable> {
        let entrypoint = (!self.has_ros()).then_some(Path::new(ENTRYPOINT));
        let command = prepare(command, &self.path(), entrypoint)?;
        self.start_prepared(command, name, children)
    }

    /// The same with a command whose program was found already.
    pub fn start_prepared(
        &self,
        mut command: Command,
        name: &str,
        children: &mut Children,
    ) -> Result<Program, NotRunnable> {
        command
            .envs(self.environment)
            .env("ROS_MASTER_URI", self.master_uri)
            .env("ROS_IP", "127.0.0.1")
            .env_remove("ROS_HOSTNAME")
            .env("ROS_HOME", self.folder)
            .env("ROS_LOG_DIR", self.folder.join("log"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0);
        let mut child = command.spawn().map_err(|error| not_started(&command, &error))?;
        let pid = Pid::from_child(&child);
        children.watch(pid);
        let prefix = format!("[{} {name}]", self.label);
        let stdout = child.stdout.take().map(|stream| Tail::follow(stream, prefix.clone()));
        let stderr = child.stderr.take().map(|stream| Tail::follow(stream, prefix));
        Ok(Program { pid, stdout, stderr })
    }
}

impl Program {
    /// The last lines on stderr so far.
    pub fn stderr(&self) -> Vec<String> {
        self.stderr.as_ref().map(Tail::lines).unwrap_or_default()
    }

    /// The last lines of stdout and stderr, once the program is gone.
    pub fn output(self) -> (Vec<String>, Vec<String>) {
        // Whoever could write is gone; what they wrote is read in no time.
        let patience = Duration::from_secs(1);
        let finish =
            |tail: Option<Tail>| tail.map(|tail| tail.finish(patience)).unwrap_or_default();
        (finish(self.stdout), finish(self.stderr))
    }
}
