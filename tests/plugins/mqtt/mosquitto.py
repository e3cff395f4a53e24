"""mosquitto as its users run it: TLS, certificates of clients, passwords, an ACL."""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_PATH = f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin"
MOSQUITTO = shutil.which("mosquitto", path=_PATH)
needs_mosquitto = pytest.mark.skipif(
    not all(shutil.which(one, path=_PATH) for one in ("mosquitto", "mosquitto_passwd", "openssl")),
    reason="mosquitto and openssl are not installed here (apt-get install mosquitto openssl)",
)
USER, PASSWORD = "wil", "of the test"
ACL = """\
user wil
topic readwrite wil/gate/#

user anna
topic read wil/gate/#
topic write wil/gate/operator/abort
topic write wil/gate/operator/hold
"""
"""anna may abort and hold, and not resume: the broker lets no such message through."""

UNNAMED = "127.0.0.2"
"""Where the broker listens too, and which its certificate does not name."""


def openssl(folder: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)  # noqa: S603, S607


def make_certificates(folder: Path) -> None:
    """Write ca.pem, and {broker,client}.{pem,key} that it vouches for; stranger.* of another."""
    for authority in ("ca", "other"):
        openssl(
            folder,
            *("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"),
            *("-keyout", f"{authority}.key", "-out", f"{authority}.pem", "-days", "2"),
            *("-subj", f"/CN={authority}"),
        )
    (folder / "names").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
    for name, authority in (("broker", "ca"), ("client", "ca"), ("stranger", "other")):
        openssl(
            folder,
            *("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"),
            *("-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}"),
        )
        openssl(
            folder,
            *("x509", "-req", "-in", f"{name}.csr", "-CA", f"{authority}.pem"),
            *("-CAkey", f"{authority}.key", "-CAcreateserial", "-days", "2"),
            *("-extfile", "names", "-out", f"{name}.pem"),
        )


@contextmanager
def mosquitto(folder: Path, port: int) -> Iterator[None]:
    """Run a broker whose certificates stand in the folder."""
    passwords = folder / "passwords"
    for new, user in (("-c", USER), ("", "anna")):
        options = [one for one in (new, "-b") if one]
        said = ["mosquitto_passwd", *options, str(passwords), user, PASSWORD]
        subprocess.run(said, check=True, capture_output=True)  # noqa: S603
    (folder / "acl").write_text(ACL)
    for name in ("passwords", "acl"):
        (folder / name).chmod(0o600)
    listeners = "".join(
        f"listener {port} {address}\nrequire_certificate true\n"
        f"cafile {folder}/ca.pem\ncertfile {folder}/broker.pem\nkeyfile {folder}/broker.key\n"
        for address in ("127.0.0.1", UNNAMED)
    )
    (folder / "mosquitto.conf").write_text(
        f"allow_anonymous false\npassword_file {passwords}\nacl_file {folder}/acl\nuser root\n"
        + listeners
    )
    arguments = [str(MOSQUITTO), "-c", str(folder / "mosquitto.conf")]
    with subprocess.Popen(arguments, stderr=subprocess.DEVNULL) as process:  # noqa: S603
        try:
            for _ in range(3000):
                if _listens(port):
                    break
                time.sleep(0.02)
            yield
        finally:
            process.kill()


def _listens(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0
