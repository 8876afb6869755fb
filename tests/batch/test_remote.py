"""Inputs in a store: a real S3 server and a real web server, on loopback."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import boto3
import missions
import pyarrow.parquet as pq
import pytest

from terrain_cli import version

ROOT = Path(__file__).resolve().parent.parent.parent
KEYS = {
    "AWS_ACCESS_KEY_ID": "test",
    "AWS_SECRET_ACCESS_KEY": "test",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_EC2_METADATA_DISABLED": "true",
}


def serve(log, sign, *command, cwd=None):
    """Start a server; return its process and what it says of its port."""
    with log.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-u", "-m", *command], stderr=stream, stdout=stream, cwd=cwd
        )
    end = time.monotonic() + 60
    while not (found := re.search(sign, log.read_text())):
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < end
        time.sleep(0.05)
    return process, found[1]


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Return the address of an S3 server that holds the drives of a mission in the bucket `rover`."""
    folder = tmp_path_factory.mktemp("store")
    process, address = serve(
        folder / "log", r"Running on (http://127\.0\.0\.1:\d+)", "moto.server", "-H", "127.0.0.1", "-p", "0"
    )
    yield address
    process.kill()
    process.wait()


@pytest.fixture
def bucket(store, tmp_path):
    missions.mission(tmp_path / "in")
    names = {"aws_access_key_id": "test", "aws_secret_access_key": "test", "region_name": "us-east-1"}
    client = boto3.client("s3", endpoint_url=store, **names)
    client.create_bucket(Bucket="rover")
    for path in (tmp_path / "in").rglob("*.csv"):
        client.upload_file(str(path), "rover", str(path.relative_to(tmp_path)))
    return client


def batch(folder, *args, **environment):
    # One worker, unless a test asks for more: each takes a while to begin.
    command = [sys.executable, "-m", "terrain_cli", "batch", "--jobs", "1", *args]
    command += ["-o", "out", "--rover", "in/rover.toml"]
    env = {**os.environ, **KEYS, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run(
        command, cwd=folder, env=env, capture_output=True, text=True, timeout=120, check=False
    )
    assert "Traceback" not in done.stderr
    return done.returncode, done.stderr


def test_s3(bucket, store, tmp_path):
    there = ("s3://rover/in/", "s3://rover/in/day*/*.csv")
    code, err = batch(tmp_path, *there, "--jobs", "2", AWS_ENDPOINT_URL=store)
    assert code == 75, err
    assert "3 done, 1 duplicates, 1 failed" in err
    assert "failed (65): s3://rover/in/empty.csv: is empty" in err
    # The same numbers as from files here.
    table = pq.read_table(tmp_path / "out/segments.parquet")
    assert sorted(set(table["source"].to_pylist())) == [
        *("s3://rover/in/b.csv", "s3://rover/in/copy.csv", "s3://rover/in/day2/a.csv")
    ]
    os.rename(tmp_path / "out", tmp_path / "remote")  # noqa: PTH104
    batch(tmp_path, "in", "in/day1", "in/day2")
    here = pq.read_table(tmp_path / "out/segments.parquet")
    assert here.drop_columns("source").equals(table.drop_columns("source"))
    os.rename(tmp_path / "out", tmp_path / "local")  # noqa: PTH104
    os.rename(tmp_path / "remote", tmp_path / "out")  # noqa: PTH104
    # Only what has changed is read again.
    bucket.put_object(Bucket="rover", Key="in/b.csv", Body=missions.drive(0.5).encode())
    code, err = batch(tmp_path, *there, AWS_ENDPOINT_URL=store)
    assert "1 done, 3 as before, 1 failed before and unchanged" in err


def test_what_is_not_there_or_too_large(bucket, store, tmp_path):
    code, err = batch(tmp_path, "s3://rover/nothing.csv", AWS_ENDPOINT_URL=store)
    says = "s3://rover/nothing.csv: no such object, or its store does not answer"
    assert (code, err) == (66, f"terrain-est: {says}\n")
    code, err = batch(tmp_path, "s3://rover/in/b.csv", "--largest", "0.000001", AWS_ENDPOINT_URL=store)
    assert code == 75
    assert "is larger than the 1e-06 GB that are copied" in err
    code, err = batch(tmp_path, "s3://rover/in/b.csv", AWS_ENDPOINT_URL=store)
    assert code == 0, err


def test_a_web_server(tmp_path):
    missions.mission(tmp_path / "in")
    process, port = serve(
        *(tmp_path / "log", r"port (\d+)"), "http.server", "0", "--bind", "127.0.0.1", cwd=tmp_path / "in"
    )
    try:
        address = f"http://127.0.0.1:{port}"
        code, err = batch(tmp_path, f"{address}/b.csv", f"{address}/day1/", f"{address}/no.csv")
        assert code == 75, err
        assert "2 done, 1 failed" in err
        assert f"failed (66): {address}/no.csv: no such object, or its store does not answer" in err
        code, err = batch(tmp_path, f"{address}/b.csv", f"{address}/day1/")
        assert (code, "2 as before" in err) == (0, True)
    finally:
        process.kill()
        process.wait()
    # Whether it is the file or the server that is missing, it may be there next time.
    code, err = batch(tmp_path, f"{address}/b.csv")
    assert code == 66
    assert "or its store does not answer" in err


def test_a_store_that_nobody_knows(tmp_path):
    missions.mission(tmp_path / "in")
    code, err = batch(tmp_path, "nonsense://rover/a.csv")
    assert code == 78
    assert err.startswith("terrain-est: nonsense://rover/a.csv: ")
    assert version.command_for("remote") in err
