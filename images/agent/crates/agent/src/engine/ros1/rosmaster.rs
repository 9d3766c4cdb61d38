//! A master of its own for each case.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use bagpipe_ros1::{Master, Meet, RosError, Rosmaster};

use crate::case::failure::Failure;
use crate::stack::command::{ENTRYPOINT, find};
use crate::stack::processes::{Children, pause};
use crate::stack::{Program, Surroundings};

/// How often a rosmaster that starts is asked.
const GLANCE: Duration = Duration::from_millis(10);
/// How long one question may take.
const QUESTION: Duration = Duration::from_secs(5);

/// Serves a master in this process, which answers from now on, and a client of it. `meet` learns of nodes that register.
pub fn serve(port: u16, uri: &str, meet: Box<Meet>) -> Result<(Rosmaster, Master), Failure> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let served = Rosmaster::serve_noting(address, meet).map_err(|error| match error {
        RosError::Io { source, .. } if source.kind() == ErrorKind::AddrInUse => taken(port),
        error => failed(error.to_string()),
    })?;
    let master = client(uri)?;
    Ok((served, master))
}

/// Starts a rosmaster; it does not answer yet.
pub fn start(
    surroundings: &Surroundings<'_>,
    port: u16,
    children: &mut Children,
) -> Result<Program, Failure> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    if TcpStream::connect_timeout(&address, Duration::from_millis(200)).is_ok() {
        return Err(taken(port));
    }
    let arguments = ["--core".to_owned(), "-p".to_owned(), port.to_string()];
    let path = surroundings.path();
    let mut command = match find("rosmaster", &path) {
        Ok(file) => Command::new(file),
        Err(_) if Path::new(ENTRYPOINT).exists() => {
            let mut wrapped = Command::new(ENTRYPOINT);
            wrapped.arg("rosmaster");
            wrapped
        }
        Err(missing) => return Err(not_found(&missing.0)),
    };
    command.args(arguments);
    surroundings
        .start_prepared(command, "rosmaster", children)
        .map_err(|wrong| Failure::new("RosMasterFailed", wrong.0))
}

/// Waits until the rosmaster answers.
pub fn await_answer(
    program: &Program,
    uri: &str,
    children: &mut Children,
    deadline: Instant,
    interrupted: &dyn Fn() -> Option<Failure>,
) -> Result<Master, Failure> {
    let master = client(uri)?;
    loop {
        let error = match master.get_pid() {
            Ok(_) => return Ok(master),
            Err(error) => error,
        };
        if let Some(ended) = children.ended(program.pid) {
            // bash says 127 where the entrypoint found no rosmaster either.
            return Err(match ended.exit_status {
                Some(127) => not_found(&program.stderr().join(" ")),
                _ => failed(format!("it ended with {ended} before it answered")),
            });
        }
        if let Some(failure) = interrupted() {
            return Err(failure);
        }
        if Instant::now() >= deadline {
            return Err(failed(format!("it did not answer within deadlines.start ({error})")));
        }
        pause(GLANCE);
    }
}

fn client(uri: &str) -> Result<Master, Failure> {
    Master::new(uri, "/bagpipe_agent", QUESTION)
        .map_err(|error| Failure::new("Internal", error.to_string()))
}

fn taken(port: u16) -> Failure {
    failed(format!(
        "port {port} is taken by another program: give `bagpipe-agent serve` another \
         --master-port, or do not start a rosmaster in the image's own services"
    ))
}

fn failed(why: String) -> Failure {
    Failure::new("RosMasterFailed", format!("the rosmaster cannot be used: {why}"))
}

fn not_found(searched: &str) -> Failure {
    Failure::new(
        "RosMasterNotFound",
        format!(
            "this image has no rosmaster ({searched}): install the package python3-rosmaster \
             (Debian, Ubuntu) or ros-noetic-rosmaster (packages.ros.org) in it, or write \
             stack.ros1.master: agent"
        ),
    )
}
