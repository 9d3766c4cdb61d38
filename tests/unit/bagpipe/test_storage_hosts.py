"""Which servers a list of hosts allows, and which server the words of a job or a Secret lead to."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.storage.servers import check_server
from bagpipe.storage_hosts import VARIABLE, allows, read_hosts, refused_uris

LIST = read_hosts("bags.example.com, *.Store.example, namenode:8020,[fd00::1]:9000")


@pytest.mark.parametrize(
    ("scheme", "server"),
    [
        ("https", "bags.example.com"),
        ("https", "BAGS.example.com."),
        ("https", "bags.example.com:8443"),
        ("https", "eu.store.example"),
        ("https", "a.b.store.example:1"),
        ("hdfs", "namenode:8020"),
        ("hdfs", "namenode"),
        ("http", "[fd00::1]:9000"),
    ],
)
def test_what_a_list_allows(scheme: str, server: str) -> None:
    assert allows(LIST, scheme, server)


@pytest.mark.parametrize(
    ("scheme", "server"),
    [
        ("https", "example.com"),
        ("https", "store.example"),
        ("https", "xstore.example"),
        ("https", "bags.example.com.evil.example"),
        ("https", "evilbags.example.com"),
        ("https", "namenode"),
        ("hdfs", "namenode:9000"),
        ("https", "169.254.169.254"),
        ("http", "[fd00::1]"),
        # Another parser may take what stands before the slash, the @ or the # for the host.
        ("https", r"evil.example\.store.example"),
        ("https", "evil.example#.store.example"),
        ("https", "evil.example?.store.example"),
        ("https", "evil.example@eu.store.example"),
        ("https", "evil.example%2f.store.example"),
        ("https", "évil.store.example"),
        ("https", ""),
        ("https", "eu.store.example\n"),
    ],
)
def test_what_it_does_not(scheme: str, server: str) -> None:
    assert not allows(LIST, scheme, server)
    assert allows((), scheme, server)


@pytest.mark.parametrize(
    "entry", ["https://a.example", "a.example/bags", "*", "*.", "a*.example", "a:http", "a b", "@"]
)
def test_an_entry_that_is_no_host_is_named(entry: str) -> None:
    with pytest.raises(ValueError, match="is no host: write for example"):
        read_hosts(f"good.example,{entry}")


@given(st.text(max_size=40))
def test_no_text_around_an_allowed_name_passes_for_it(text: str) -> None:
    """Only what is a name below the domain, with or without a port, ends in it and is allowed."""
    server = f"{text}.store.example"
    if allows(LIST, "https", server):
        assert all(letter.isalnum() or letter in "._-" for letter in text)
        assert text.isascii()


def test_uris_that_name_a_server_are_looked_at_and_others_are_not() -> None:
    uris = [
        "https://bags.example.com/a.bag", "https://evil.example/a.bag", "hdfs://evil/x",
        "s3://bucket/a.bag", "pvc://claim/a.bag", "file:///mnt/a.bag",
    ]  # fmt: skip
    assert refused_uris(LIST, uris) == ["https://evil.example/a.bag", "hdfs://evil/x"]
    assert refused_uris((), uris) == []


KEY = '{"gcs_base_url": "%s", "disable_oauth": true}'
AS_A_LIST = '["", "", "", "https://evil.example", true]'
ALLOWED = [
    ("s3", {}, "s3.us-east-1.amazonaws.com"),
    ("s3", {"AWS_REGION": "eu-west-1"}, "s3.eu-west-1.amazonaws.com"),
    ("s3", {"AWS_DEFAULT_REGION": "eu-west-1"}, "s3.eu-west-1.amazonaws.com"),
    ("s3", {"AWS_ENDPOINT_URL": "http://minio.lab:9000", "AWS_REGION": "lab"}, "minio.lab:9000"),
    ("s3", {"AWS_ENDPOINT_URL": "https://minio.lab/s3/"}, "minio.lab:443"),
    ("gs", {}, "storage.googleapis.com"),
    ("gs", {"GOOGLE_SERVICE_ACCOUNT_KEY": '{"private_key": ""}'}, "storage.googleapis.com"),
    ("gs", {"GOOGLE_SERVICE_ACCOUNT_KEY": KEY % "http://gcs.lab:4443"}, "gcs.lab"),
    ("az", {"AZURE_STORAGE_ACCOUNT_NAME": "lanes7"}, "lanes7.blob.core.windows.net"),
]


@pytest.mark.parametrize(("scheme", "environment", "host"), ALLOWED)
def test_where_a_bucket_is(scheme: str, environment: dict[str, str], host: str) -> None:
    check_server(scheme, "bucket", environment)
    check_server(scheme, "bucket", environment | {VARIABLE: f"other.example,{host}"})
    with pytest.raises(PermissionError, match="an administrator to add it to"):
        check_server(scheme, "bucket", environment | {VARIABLE: "other.example"})


@pytest.mark.parametrize(
    ("scheme", "environment", "sentence"),
    [
        ("s3", {"AWS_REGION": "x.evil.example/"}, "AWS_REGION holds more than letters"),
        ("s3", {"AWS_DEFAULT_REGION": "x@evil"}, "AWS_DEFAULT_REGION holds more than letters"),
        # The region is also of the server that is shown the pod's web identity: sts.<region>.
        (
            "s3",
            {"AWS_ENDPOINT_URL": "http://minio.amazonaws.com", "AWS_REGION": "x@evil.example/"},
            "AWS_REGION holds more than letters",
        ),
        ("s3", {"AWS_ENDPOINT_URL": "minio:9000"}, "AWS_ENDPOINT_URL is no URL"),
        ("s3", {"AWS_ENDPOINT_URL": "http://u:p@minio"}, "AWS_ENDPOINT_URL names no server"),
        ("s3", {"AWS_ENDPOINT_URL": "http://evil\\.amazonaws.com"}, "names no server"),
        ("gs", {"GOOGLE_SERVICE_ACCOUNT_KEY": "{"}, "GOOGLE_SERVICE_ACCOUNT_KEY holds no JSON"),
        ("gs", {"GOOGLE_SERVICE_ACCOUNT_KEY": "[" * 9000}, "holds no JSON"),
        # obstore takes the fields without their names too, in the order of its own struct.
        ("gs", {"GOOGLE_SERVICE_ACCOUNT_KEY": AS_A_LIST}, "holds no JSON object"),
        ("gs", {"GOOGLE_SERVICE_ACCOUNT_KEY": KEY % "evil"}, "gcs_base_url in GOOGLE_.* is no URL"),
        ("az", {"AZURE_STORAGE_ACCOUNT_NAME": "evil.example/x"}, "ACCOUNT_NAME holds more"),
    ],
)
def test_what_a_secret_must_not_make_of_a_host(
    scheme: str, environment: dict[str, str], sentence: str
) -> None:
    """With and without a list: a library would build another server's URL of it, or panic."""
    for given_list in ({}, {VARIABLE: "*.amazonaws.com,*.windows.net,*.googleapis.com"}):
        with pytest.raises(OSError, match=sentence) as refused:
            check_server(scheme, "bucket", environment | given_list)
        assert not any(value in str(refused.value) for value in environment.values())


@pytest.mark.parametrize("bucket", ["evil.example#", "evil.example?", "a@b", "a:1", ""])
@pytest.mark.parametrize("scheme", ["s3", "gs", "az"])
def test_a_bucket_makes_no_other_host(scheme: str, bucket: str) -> None:
    with pytest.raises(OSError, match="the URI names no bucket"):
        check_server(scheme, bucket, {"AWS_VIRTUAL_HOSTED_STYLE_REQUEST": "true"})


def test_a_line_s_end_after_an_endpoint_is_none_of_it() -> None:
    given_list = {VARIABLE: "minio.lab:9000"}
    check_server("s3", "bucket", {"AWS_ENDPOINT_URL": "http://minio.lab:9000\n"} | given_list)
    with pytest.raises(OSError, match="AWS_ENDPOINT_URL names no server"):
        check_server("s3", "bucket", {"AWS_ENDPOINT_URL": "http://minio.lab\n.evil"} | given_list)


def test_every_endpoint_that_the_library_may_choose_must_be_allowed() -> None:
    both = {"AWS_ENDPOINT_URL": "http://good:9000", "AWS_ENDPOINT_URL_S3": "http://evil:9000"}
    with pytest.raises(PermissionError, match="AWS_ENDPOINT_URL_S3 leads to a server"):
        check_server("s3", "bucket", both | {VARIABLE: "good"})
