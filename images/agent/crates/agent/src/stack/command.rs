//! Which program a command means, and what to say when there is none.

use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::fs::{Access, access};

/// What official ROS images set their environment up with.
pub const ENTRYPOINT: &str = "/ros_entrypoint.sh";

/// Why a command cannot be run.
#[derive(Debug, PartialEq, Eq)]
pub struct NotRunnable(pub String);

/// Finds the program as a shell would.
pub fn find(program: &str, path: &str) -> Result<PathBuf, NotRunnable> {
    if program.contains('/') {
        let file = PathBuf::from(program);
        return match check(&file) {
            Found::Runnable => Ok(file),
            Found::NotExecutable => Err(not_executable(&file)),
            Found::Missing => Err(NotRunnable(format!("{program} does not exist in this image"))),
        };
    }
    let mut closed = None;
    for folder in path.split(':').filter(|folder| !folder.is_empty()) {
        let file = Path::new(folder).join(program);
        match check(&file) {
            Found::Runnable => return Ok(file),
            Found::NotExecutable => closed = Some(file),
            Found::Missing => {}
        }
    }
    Err(match closed {
        Some(file) => not_executable(&file),
        None => NotRunnable(format!("{program} is in no folder of PATH ({path})")),
    })
}

/// The command itself (its program searched in `path`), or through the image's own entrypoint when the environment is not
/// set up: Kubernetes replaced that entrypoint by the agent.
pub fn prepare(
    command: &[String],
    path: &str,
    entrypoint: Option<&Path>,
) -> Result<Command, NotRunnable> {
    let Some((program, arguments)) = command.split_first() else {
        return Err(NotRunnable("the command is empty".to_owned()));
    };
    if let Some(entrypoint) = entrypoint.filter(|entrypoint| entrypoint.exists()) {
        let mut wrapped = Command::new(entrypoint);
        wrapped.args(command);
        return Ok(wrapped);
    }
    let mut direct = Command::new(find(program, path)?);
    direct.args(arguments);
    Ok(direct)
}

/// What starting a program that exists failed with.
pub fn not_started(command: &Command, error: &std::io::Error) -> NotRunnable {
    let program = Path::new(command.get_program()).display();
    NotRunnable(match error.kind() {
        std::io::ErrorKind::NotFound => format!(
            "{program} exists, but the interpreter or loader that it names does not; look at \
             its first line, or whether it is a program for this kind of machine"
        ),
        _ => format!("{program} cannot be started: {error}"),
    })
}

fn not_executable(file: &Path) -> NotRunnable {
    let file = file.display();
    NotRunnable(format!("{file} is not executable; make it so with chmod +x in the image"))
}

enum Found {
    Runnable,
    NotExecutable,
    Missing,
}

fn check(file: &Path) -> Found {
    if !file.exists() {
        Found::Missing
    } else if file.is_file() && access(file, Access::EXEC_OK).is_ok() {
        Found::Runnable
    } else {
        Found::NotExecutable
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn not_found_and_not_executable_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_str().unwrap();
        let missing = find("no-such-node", path).unwrap_err().0;
        assert_eq!(missing, format!("no-such-node is in no folder of PATH ({path})"));
        std::fs::write(folder.path().join("node"), "#!/bin/sh\n").unwrap();
        let closed = find("node", path).unwrap_err().0;
        assert!(closed.contains("/node is not executable"), "{closed}");
        assert!(find("/no/such/node", path).unwrap_err().0.contains("does not exist"));
        assert!(find(path, path).unwrap_err().0.contains("is not executable"));
        assert_eq!(find("sh", "/nowhere:/bin"), Ok(PathBuf::from("/bin/sh")));
    }

    #[test]
    fn an_images_entrypoint_sets_its_environment_up() {
        let folder = tempfile::tempdir().unwrap();
        let entrypoint = folder.path().join("ros_entrypoint.sh");
        let command = ["node".to_owned(), "--fast".to_owned()];
        // Without one, the program must be in PATH.
        assert!(prepare(&command, "/nowhere", Some(&entrypoint)).is_err());
        std::fs::write(&entrypoint, "#!/bin/bash\nexec \"$@\"\n").unwrap();
        let wrapped = prepare(&command, "/nowhere", Some(&entrypoint)).unwrap();
        assert_eq!(wrapped.get_program(), entrypoint.as_os_str());
        assert_eq!(wrapped.get_args().collect::<Vec<_>>(), ["node", "--fast"]);
        assert!(prepare(&command, "/nowhere", None).is_err());
    }
}
