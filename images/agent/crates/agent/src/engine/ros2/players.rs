//! Which player plays a case: the one by the image's librcl, or the one on DDS alone where there is
//! none that can be loaded.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_ros2::{QosOverride, Ros2, Ros2Options};
use bagpipe_ros2ledger::{Ledger, uncounted};
use bagpipe_ros2player::PlayerError;

use crate::case::Player;
use crate::case::failure::Failure;
use crate::engine::nodes::host::{ChosenPlayer, Occasion, PlayerName};
use crate::engine::ros2::environment::{First, Variables, await_first, prefixes};
use crate::engine::ros2::fastdds::Places;
use crate::engine::ros2::files::Files;
use crate::engine::ros2::transports::with_transports;

/// How long a player may take for its start and for each answer.
const DEADLINE: Duration = Duration::from_secs(20);
/// How often a player on DDS looks whether somebody is there.
const LOOK: Duration = Duration::from_millis(50);
const BY_JOB: &str = "the job asks for it";

/// What the job asks of a player.
pub struct Wanted {
    pub qos: BTreeMap<String, QosOverride>,
    /// Nodes whose state is asked for.
    pub active: Vec<String>,
    /// Whether the stack's nodes wait for room in sockets when they publish.
    pub flow_control: bool,
}

/// What a player is started in.
pub struct Setting {
    /// Of a player that no node gives any.
    pub variables: Variables,
    /// Where what a player reads is written.
    pub folder: PathBuf,
    pub places: Option<Places>,
}

/// What starts players.
pub struct Players {
    ledger: Arc<Ledger>,
    files: Files,
    wanted: Wanted,
    setting: Setting,
    pids: Vec<u32>,
    /// One on DDS that looks for who uses no ROS 2 that can be seen from outside; when it last did.
    scout: Option<Ros2>,
    looked: Option<Instant>,
    chosen: Option<ChosenPlayer>,
}

impl Players {
    pub fn new(ledger: Arc<Ledger>, files: Files, wanted: Wanted, setting: Setting) -> Players {
        Players {
            ledger,
            files,
            wanted,
            setting,
            pids: Vec::new(),
            scout: None,
            looked: None,
            chosen: None,
        }
    }

    /// The processes of all that were started.
    pub fn pids(&self) -> Vec<u32> {
        self.pids.clone()
    }

    pub fn chosen(&self) -> Option<&ChosenPlayer> {
        self.chosen.as_ref()
    }

    /// Starts the player that the job asks for, or that the image allows.
    pub fn choose(&mut self, wanted: Player, occasion: &Occasion<'_>) -> Result<Ros2, Failure> {
        match wanted {
            Player::Auto => self.whichever(occasion),
            Player::Rcl => {
                let variables = match await_first(&self.ledger, occasion, &mut || false)? {
                    First::Node(variables) => variables,
                    First::Stranger | First::Nobody => self.setting.variables.clone(),
                };
                let started = self.by_rcl(variables)?;
                self.settle(PlayerName::Rcl, BY_JOB.to_owned(), started)
            }
            Player::Dds => {
                let started = self.on_dds(self.setting.variables.clone())?;
                self.settle(PlayerName::Dds, BY_JOB.to_owned(), started)
            }
        }
    }

    /// By librcl where it can be loaded. Programs that use no ROS 2 that can be seen from outside are
    /// found by a player on DDS.
    fn whichever(&mut self, occasion: &Occasion<'_>) -> Result<Ros2, Failure> {
        let ledger = Arc::clone(&self.ledger);
        let first = await_first(&ledger, occasion, &mut || self.sees_others())?;
        let (variables, somebody) = match first {
            First::Node(variables) => (variables, true),
            First::Stranger => (self.setting.variables.clone(), true),
            First::Nobody => (self.setting.variables.clone(), false),
        };
        let scout = self.scout.take();
        match self.by_rcl(variables.clone())? {
            Err(error) if error.is_without_librcl() && somebody => {
                let started = match scout {
                    Some(scout) => Ok(scout),
                    None => self.on_dds(variables)?,
                };
                self.settle(PlayerName::Dds, error.to_string(), started)
            }
            other => self.settle(PlayerName::Rcl, "librcl is there".to_owned(), other),
        }
    }

    /// Whether a player on DDS, which is started by the first call, sees somebody. Trouble with it is
    /// reported if it is needed.
    fn sees_others(&mut self) -> bool {
        if self.looked.is_some_and(|last| last.elapsed() < LOOK) {
            return false;
        }
        if self.looked.replace(Instant::now()).is_none() {
            let started = self.on_dds(self.setting.variables.clone());
            self.scout = started.ok().and_then(Result::ok);
        }
        self.scout.as_ref().is_some_and(|scout| scout.sees_others().unwrap_or(false))
    }

    fn by_rcl(&mut self, variables: Variables) -> Result<Result<Ros2, PlayerError>, Failure> {
        let Setting { folder, places, .. } = &self.setting;
        let variables = with_transports(variables, folder, places.as_ref()).map_err(|error| {
            Failure::new("Internal", format!("cannot write into {}: {error}", folder.display()))
        })?;
        Ok(self.start(self.files.program.clone(), variables))
    }

    fn on_dds(&mut self, variables: Variables) -> Result<Result<Ros2, PlayerError>, Failure> {
        let program = self.files.put_dds_program()?;
        Ok(self.start(program, variables))
    }

    fn start(&mut self, program: PathBuf, variables: Variables) -> Result<Ros2, PlayerError> {
        let variables = uncounted(variables, &self.files.library);
        let ros2 = Ros2::start(Ros2Options {
            ledger: Arc::clone(&self.ledger),
            program,
            prefixes: prefixes(&variables),
            environment: variables,
            qos: self.wanted.qos.clone(),
            active: self.wanted.active.clone(),
            flow_control: self.wanted.flow_control,
            deadline: DEADLINE,
        })?;
        self.pids.push(ros2.pid());
        Ok(ros2)
    }

    fn settle(
        &mut self,
        name: PlayerName,
        why: String,
        started: Result<Ros2, PlayerError>,
    ) -> Result<Ros2, Failure> {
        let ros2 = started.map_err(|error| Failure::new("Ros2Failed", error.to_string()))?;
        if name == PlayerName::Dds && !self.wanted.active.is_empty() {
            let why = format!(
                "stack.ros2.active names {}, whose state the image's librcl alone can ask for, and \
                 it is played on DDS: {why}",
                self.wanted.active.join(", ")
            );
            return Err(Failure::new("Ros2Failed", why));
        }
        self.chosen = Some(ChosenPlayer { name, why });
        Ok(ros2)
    }
}
