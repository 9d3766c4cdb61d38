"""Completion: the scripts for shells, and what kubectl asks of its plugin."""

import importlib.metadata
import json
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.kubectl import proposals
from bagpipe.cli.verb import Verb

# What the list of verbs has room for on 80 columns.
SHORT = 45


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_each_shell(shell: str) -> None:
    ended = CliRunner().invoke(main, ["completion", shell])
    assert ended.exit_code == 0
    assert f"_BAGPIPE_COMPLETE={shell}_complete" in ended.output
    assert CliRunner().invoke(main, ["completion", "csh"]).exit_code == 2


def test_bash_reads_its_script_and_completes_a_verb() -> None:
    script = CliRunner().invoke(main, ["completion", "bash"]).output
    # As bash does on Tab after "bagpipe wat".
    asks = (
        f"{script}\n_BAGPIPE_COMPLETE=bash_complete COMP_WORDS='bagpipe wat' COMP_CWORD=1"
        f' "{sys.executable}" -c \'from bagpipe.cli.__main__ import main;'
        ' main(prog_name="bagpipe")\'; complete -p bagpipe'
    )
    done = subprocess.run(
        ["bash", "-c", asks], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.splitlines() == [
        "plain,watch",
        "complete -o nosort -F _bagpipe_completion bagpipe",
    ], done.stderr


@pytest.mark.parametrize(
    ("words", "first", "directive"),
    [
        (["wat"], "watch", ":4"),
        (["results", "--out"], "--output", ":4"),
        (["watch", "x", "--output", "j"], "json", ":4"),
        (["submit", ""], None, ":0"),
        (["results", "jo"], "job/", ":0"),
        ([], "bag", ":4"),
    ],
)
def test_proposals_for_kubectl(words: list[str], first: str | None, directive: str) -> None:
    found = proposals(words)
    assert found[-1] == directive
    assert [line.split("\t")[0] for line in found[:-1]][:1] == ([first] if first else [])


def test_without_a_cluster_no_name_is_proposed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KUBECONFIG", "/nowhere")
    assert proposals(["watch", "night"]) == [":4"]


@pytest.mark.timeout(60)
def test_a_cluster_that_never_answers_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        config = {
            "apiVersion": "v1",
            "kind": "Config",
            "current-context": "lab",
            "clusters": [
                {
                    "name": "lab",
                    "cluster": {"server": f"http://127.0.0.1:{silent.getsockname()[1]}"},
                }
            ],
            "contexts": [{"name": "lab", "context": {"cluster": "lab"}}],
        }
        (tmp_path / "config").write_text(json.dumps(config))
        monkeypatch.setenv("KUBECONFIG", str(tmp_path / "config"))
        assert proposals(["watch", "night"]) == [":4"]


def test_kubectl_finds_the_plugin_and_its_completion() -> None:
    scripts = {
        entry.name: entry.value
        for entry in importlib.metadata.entry_points(group="console_scripts")
    }
    assert scripts["kubectl-bagpipe"] == "bagpipe.cli.kubectl:main"
    assert scripts["kubectl_complete-bagpipe"] == "bagpipe.cli.kubectl:complete"


@pytest.mark.parametrize(
    "does",
    ["proposals(['wat'])", "proposals(['results', '--out'])", "helped()"],
    ids=["verbs", "options", "help"],
)
def test_the_program_starts_without_what_only_some_verbs_need(does: str) -> None:
    code = (
        "import sys\n"
        "from click.testing import CliRunner\n"
        "from bagpipe.cli.kubectl import program, proposals\n"
        "def helped():\n"
        "    shown = CliRunner().invoke(program, ['--help'])\n"
        "    assert shown.exit_code == 0, shown.output\n"
        "    return shown.output\n"
        f"assert len({does}) > 1\n"
        "print({'pyspark', 'pyarrow', 'kubernetes', 'bagpipe_bag', 'numpy', 'cel',"
        " 'vehiclemodels', 'prompt_toolkit'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stdout, done.stderr) == ("set()\n", "")


def test_every_verb_is_there_when_it_is_asked_for() -> None:
    for name, verb in main.commands.items():
        assert isinstance(verb, Verb)
        assert verb.load().name == name
        assert len(verb.get_short_help_str()) <= SHORT


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_can_read_their_scripts(shell: str, tmp_path: Path) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not installed")
    script = tmp_path / "script"
    script.write_text(CliRunner().invoke(main, ["completion", shell]).output)
    read = subprocess.run(
        [program, "-n", str(script)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (read.returncode, read.stderr) == (0, "")
