//! What a failure comes of where ROS 2's security is on: rcl has no word for it.

use std::ffi::OsString;

use crate::PlayerError;
use crate::options::PlayerOptions;
use crate::program::Program;

/// Where rcl looks for the player's keys, and what they must be for.
pub(crate) struct Security {
    enclave: String,
    domain: String,
}

impl Security {
    /// `None` where security is off.
    pub(crate) fn of(options: &PlayerOptions) -> Option<Security> {
        let variable = |name: &str| {
            let text = variable(options, name).unwrap_or_default();
            text.to_string_lossy().into_owned()
        };
        if variable("ROS_SECURITY_ENABLE") != "true" {
            return None;
        }
        let enclave = match variable("ROS_SECURITY_KEYSTORE") {
            none if none.is_empty() => "a folder that ROS_SECURITY_KEYSTORE does not name".into(),
            keystore => {
                let name = variable("ROS_SECURITY_ENCLAVE_OVERRIDE");
                let path = format!("{keystore}/enclaves/{}", name.trim_start_matches('/'));
                path.trim_end_matches('/').to_owned()
            }
        };
        let domain = match variable("ROS_DOMAIN_ID") {
            none if none.is_empty() => "0".to_owned(),
            domain => domain,
        };
        Some(Security { enclave, domain })
    }

    /// The same error with what security asks for, if it can be one of security. `what`: what the
    /// program was to do.
    pub(crate) fn explain(&self, error: PlayerError, what: &str, program: &Program) -> PlayerError {
        const RCL_RET_ERROR: i32 = 1;
        match error {
            PlayerError::Join { function, code, reason, .. }
            | PlayerError::Call { function, code, reason }
                if function.starts_with("rcl_") && code == RCL_RET_ERROR =>
            {
                let errors = program.last_lines();
                let (what, enclave) = (what.to_owned(), self.enclave.clone());
                let domain = self.domain.clone();
                let call = Box::new(PlayerError::Call { function, code, reason });
                PlayerError::Secured { what, call, enclave, domain, errors }
            }
            other => other,
        }
    }
}

/// What the program has of a variable.
fn variable(options: &PlayerOptions, name: &str) -> Option<OsString> {
    if options.removed.iter().any(|one| one == name) {
        return None;
    }
    let own = options.environment.iter().rev().find(|(one, _)| one == name);
    own.map(|(_, value)| value.clone()).or_else(|| std::env::var_os(name))
}
