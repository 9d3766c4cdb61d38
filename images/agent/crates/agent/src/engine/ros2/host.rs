//! What ROS 2's nodes need around them: a ledger, a domain of their own, and a player among them.

use std::cell::RefCell;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::sync::Arc;

use bagpipe_graph::Middleware;
use bagpipe_log::RecordingFormat;
use bagpipe_mcap::{Compression, WriterOptions};
use bagpipe_ros2::QosOverride;
use bagpipe_ros2ledger::{Ledger, LedgerError};
use bagpipe_ros2player::{Durability, Reliability};
use bagpipe_wire::Abort;
use rustix::process::Pid;

use crate::case::failure::Failure;
use crate::case::{self, Case};
use crate::engine::nodes::host::{ChosenPlayer, Ending, Host, Occasion, PlayerName};
use crate::engine::ros2::domain::{DOMAINS, Domain, cyclone};
use crate::engine::ros2::fastdds::Places;
use crate::engine::ros2::files::Files;
use crate::engine::ros2::players::{Players, Setting, Wanted};
use crate::engine::ros2::{environment, parameters, roll, zenoh};
use crate::engine::task::Task;
use crate::stack::Variables;
use crate::stack::end::StackEnd;
use crate::stack::exit_code::Exit;
use crate::stack::nodes::{Found, Known};

/// A case's domain, and who counts in it.
pub struct Ros2Host<'a> {
    case: &'a Case,
    files: Files,
    ledger: Arc<Ledger>,
    domain: Domain,
    places: Option<Places>,
    /// Where ROS may write.
    folder: PathBuf,
    players: RefCell<Option<Players>>,
}

impl<'a> Ros2Host<'a> {
    pub fn new(task: &'a Task<'_>, folder: &std::path::Path) -> Result<Self, Failure> {
        let ledger = Ledger::new().map_err(|error| Failure::new("Internal", error.to_string()))?;
        // Before the first node is there: one that sleeps already could not notice.
        ledger.watch_matches(true);
        let files = Files::put(task.folder)?;
        let domain = Domain::hold(task.port)?;
        let places = Places::write(domain.number, folder, |name| theirs(task.case, name));
        let places = places.map_err(|error| {
            Failure::new("Internal", format!("cannot write into {}: {error}", folder.display()))
        })?;
        Ok(Self {
            case: task.case,
            files,
            ledger: Arc::new(ledger),
            domain,
            places,
            folder: folder.to_owned(),
            players: RefCell::default(),
        })
    }

    fn parameter_file(&self) -> PathBuf {
        self.folder.join("parameters.yaml")
    }

    /// What a process of the stack would find that changes nothing of it.
    fn own_variables(&self) -> environment::Variables {
        let job = self.case.stack.environment.iter();
        let job = job.map(|(name, value)| (OsString::from(name), OsString::from(value)));
        let own = self.variables().set.into_iter();
        let own = own.map(|(name, value)| (OsString::from(name), value));
        job.chain(own).collect()
    }

    fn theirs(&self, name: &str) -> Option<OsString> {
        theirs(self.case, name)
    }

    /// The quality of service by the names that topics are played under.
    fn qos(&self) -> std::collections::BTreeMap<String, QosOverride> {
        let stack = &self.case.stack;
        let mut by_name = std::collections::BTreeMap::new();
        for (recorded, qos) in &stack.qos {
            let played: Vec<&String> = stack
                .remap
                .iter()
                .filter(|(_, from)| *from == recorded)
                .map(|(name, _)| name)
                .collect();
            let wanted = wanted(qos);
            match played.is_empty() {
                true => _ = by_name.insert(recorded.clone(), wanted),
                false => by_name.extend(played.into_iter().map(|name| (name.clone(), wanted))),
            }
        }
        by_name
    }
}

/// A variable of the job, or else of the container.
fn theirs(case: &Case, name: &str) -> Option<OsString> {
    let own = case.stack.environment.get(name).map(OsString::from);
    own.or_else(|| std::env::var_os(name))
}

fn wanted(qos: &case::Qos) -> QosOverride {
    QosOverride {
        reliability: qos.reliability.map(|wanted| match wanted {
            case::Reliability::Reliable => Reliability::Reliable,
            case::Reliability::BestEffort => Reliability::BestEffort,
        }),
        durability: qos.durability.map(|wanted| match wanted {
            case::Durability::Volatile => Durability::Volatile,
            case::Durability::TransientLocal => Durability::TransientLocal,
        }),
        depth: qos.depth.map(u32::from),
    }
}

/// What a fault may come of where ROS 2's security is on; nothing if of something else.
fn security(reason: &str, player: Option<PlayerName>, domain: u16) -> String {
    match (reason, player) {
        ("NeverSubscribed", Some(PlayerName::Dds)) => "; ROS_SECURITY_ENABLE is true, and the \
            player on DDS has no security, so that it meets no secured node: let \
            stack.ros2.player be rcl"
            .to_owned(),
        // Security itself is silent: who is not let in is as if not there.
        ("NeverSubscribed", Some(PlayerName::Rcl)) => "; ROS_SECURITY_ENABLE is true: keys that \
            are missing, of another authority, or without a permission keep the player apart"
            .to_owned(),
        // Before a player has met a node.
        ("StackExited" | "StackCrashed", None) => format!(
            "; ROS_SECURITY_ENABLE is true, and the case is in domain {domain}: governance and \
             permissions must let nodes into the domains 1 to {DOMAINS}"
        ),
        _ => String::new(),
    }
}

impl Host for Ros2Host<'_> {
    fn variables(&self) -> Variables {
        let preload = self.theirs("LD_PRELOAD");
        let mut set = vec![
            ("ROS_DOMAIN_ID", self.domain.number.to_string().into()),
            // The first is Iron's and later ones', the second what was before.
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST".into()),
            ("ROS_LOCALHOST_ONLY", "1".into()),
            ("ROS_HOME", self.folder.clone().into()),
            ("ROS_LOG_DIR", self.folder.join("log").into()),
            ("CYCLONEDDS_URI", cyclone(self.theirs("CYCLONEDDS_URI"))),
            ("BAGPIPE_PARAMETERS", self.parameter_file().into()),
        ];
        set.extend(zenoh::variables(self.domain.number, |name| self.theirs(name)));
        set.extend(self.places.iter().flat_map(Places::variables));
        let preload = preload.as_deref().map(OsStr::new);
        set.extend(self.ledger.environment(&self.files.library, preload));
        Variables { set, removed: &[] }
    }

    fn command(&self) -> Result<Vec<String>, Failure> {
        let stack = &self.case.stack;
        let file = self.parameter_file();
        let text = parameters::file(&stack.parameters).map_err(Failure::protocol)?;
        std::fs::write(&file, text).map_err(|error| {
            Failure::new("Internal", format!("cannot write {}: {error}", file.display()))
        })?;
        Ok(match stack.parameters.is_empty() {
            true => stack.command.clone(),
            false => parameters::with_file(&stack.command, &file),
        })
    }

    fn start(&self, _: &Occasion<'_>) -> Result<(), Failure> {
        Ok(())
    }

    fn meet(&self, occasion: &Occasion<'_>) -> Result<Arc<dyn Middleware>, Failure> {
        let wanted = Wanted {
            qos: self.qos(),
            active: self.case.stack.active.clone(),
            flow_control: self.case.stack.flow_control,
        };
        let mut players = Players::new(
            Arc::clone(&self.ledger),
            self.files.clone(),
            wanted,
            Setting {
                variables: self.own_variables(),
                folder: self.folder.clone(),
                places: self.places.clone(),
            },
        );
        let ros2 = players.choose(self.case.stack.player, occasion);
        if let Some(chosen) = players.chosen() {
            let label = &occasion.surroundings.label;
            eprintln!("[{label}] played by {}: {}", chosen.name, chosen.why);
        }
        self.players.replace(Some(players));
        Ok(Arc::new(ros2?))
    }

    fn processes(&self) -> Vec<Pid> {
        let players = self.players.borrow();
        let pids = players.iter().flat_map(|players| players.pids());
        pids.filter_map(|pid| Pid::from_raw(pid.cast_signed())).collect()
    }

    fn chosen_player(&self) -> Option<ChosenPlayer> {
        self.players.borrow().as_ref().and_then(|players| players.chosen().cloned())
    }

    fn explain(&self, abort: Abort, stack: Option<StackEnd>, _: Ending) -> Abort {
        let mut abort = match stack {
            Some(stack) => stack.explain(abort),
            None => abort,
        };
        let player = self.chosen_player().map(|chosen| chosen.name);
        let implementation = self.theirs("RMW_IMPLEMENTATION");
        let advice = zenoh::advice(implementation.as_deref(), &abort.reason, player);
        abort.message.push_str(advice);
        if self.theirs("ROS_SECURITY_ENABLE").is_some_and(|value| value == "true") {
            abort.message.push_str(&security(&abort.reason, player, self.domain.number));
        }
        abort
    }

    fn record_as(&self) -> Arc<dyn RecordingFormat> {
        let options = WriterOptions::with_compression(Compression::Lz4);
        Arc::new(WriterOptions { profile: "ros2".to_owned(), ..options })
    }

    fn use_sim_time(&self) -> bool {
        parameters::use_sim_time(&self.case.stack.parameters)
    }

    fn roll(&self) -> Result<Vec<Known>, Failure> {
        roll::roll(&self.ledger).map_err(|error| unknown(&error))
    }

    fn met(&self) -> Vec<Known> {
        roll::met(&self.ledger)
    }

    fn note_stayed(&self, known: &mut [Known]) -> Result<(), Failure> {
        roll::note_stayed(&self.ledger, known).map_err(|error| unknown(&error))
    }

    fn exits(&self) -> Result<Vec<Exit>, Failure> {
        roll::exits(&self.ledger).map_err(|error| unknown(&error))
    }

    fn look(&self, known: &[Known]) -> Result<Vec<Found>, Failure> {
        roll::look(&self.ledger, known).map_err(|error| unknown(&error))
    }
}

fn unknown(error: &LedgerError) -> Failure {
    let what = format!("which nodes were there during the case can't be known: {error}");
    Failure::new("Ros2Failed", what)
}
