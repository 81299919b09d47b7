"""Delivery of incidents to a real server that fails, hangs, answers twice; text of an e-mail."""

import hmac
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email import message_from_string, policy
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from pipeline.monitoring.delivery import Webhook, deliver, deliveries, email_text
from pipeline.schema.incident import Event, Incident

EVENT = Event(
    rule="load_over_limit", component="spindle drive", severity="act", value=131.0, limit=110.0,
    start="2026-03-04T10:00:00Z", end="2026-03-04T10:02:00Z", unit="%", values={"load": 131.0},
    words={"program": "O2040"},
)  # fmt: skip
INCIDENT = Incident(
    id="0123456789abcdef", machine="mill01", origin="simulated", component="spindle drive",
    severity="act", title="Spindle load over its limit", check="Tool and its edge.",
    who="process engineer", start=EVENT.start, end=EVENT.end, seconds=120.0, count=1,
    events=(EVENT,),
)  # fmt: skip


@dataclass
class Receiver:
    """A server that answers as its plan says, and counts what came by its idempotency key."""

    plan: list[int | str]
    """Status of each answer; ``hang``: none until the end, ``cut``: the connection is closed."""
    requests: list[tuple[dict[str, str], bytes]] = field(default_factory=list)
    url: str = ""

    @property
    def counted(self) -> int:
        """Incidents that a receiver counts, by key."""
        return len({headers["Idempotency-Key"] for headers, _ in self.requests})


@contextmanager
def receiver(*plan: int | str) -> Iterator[Receiver]:
    found, ended = Receiver(list(plan)), threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            found.requests.append((dict(self.headers), body))
            answer = found.plan.pop(0) if found.plan else 200
            if answer == "hang":
                ended.wait(30)
            elif answer == "cut":
                self.connection.shutdown(socket.SHUT_RDWR)
            else:
                self.send_response(int(answer))
                if answer == 429:
                    self.send_header("Retry-After", "7")
                self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        found.url = f"http://127.0.0.1:{server.server_port}/hook?token=t"
        try:
            yield found
        finally:
            ended.set()
            server.shutdown()
            thread.join()


def sent(to: Receiver, ledger: Path, **settings: object) -> tuple[list[str], list[float]]:
    """Results of a run at a time that is known, and its waits."""
    waits: list[float] = []
    hook = Webhook(url=to.url, secret=b"key", timeout_s=0.3, **settings)  # type: ignore[arg-type]
    done = deliver([INCIDENT], hook, ledger, now=lambda: 1.7e9, wait=waits.append)
    return [f"{one.result} {one.attempts} {one.why}".strip() for one in done], waits


def test_an_incident_is_delivered_once_over_runs_with_its_signature(tmp_path: Path) -> None:
    with receiver() as to:
        ledger = tmp_path / "delivered/mill01.jsonl"
        assert sent(to, ledger) == (["delivered 1"], [])
        assert sent(to, ledger) == ([], [])
    ((headers, body),) = to.requests
    assert json.loads(body)["id"] == headers["Idempotency-Key"] == INCIDENT.id
    assert json.loads(body)["origin"] == "simulated"
    own = hmac.new(b"key", b"1700000000." + body, "sha256").hexdigest()
    assert headers["Kerf-Signature"] == f"t=1700000000,v1={own}"
    (one,) = deliveries(ledger)
    assert "token" not in one.to and one.at == "2023-11-14T22:13:20+00:00"


def test_a_server_that_fails_and_hangs_gets_it_again_with_the_same_key(tmp_path: Path) -> None:
    with receiver(500, "hang", "cut", 503, 200) as to:
        assert sent(to, tmp_path / "l.jsonl") == (["delivered 5"], [1.0, 2.0, 4.0, 8.0])
        assert len(to.requests) == 5 and to.counted == 1
        assert len({body for _, body in to.requests}) == 1


def test_a_receiver_that_took_it_before_its_answer_was_lost_counts_it_once(tmp_path: Path) -> None:
    with receiver("cut", 409) as to:
        assert sent(to, tmp_path / "l.jsonl")[0] == ["delivered 2"]
        assert len(to.requests) == 2 and to.counted == 1
        assert sent(to, tmp_path / "l.jsonl") == ([], [])


def test_a_wait_that_is_requested_is_kept(tmp_path: Path) -> None:
    with receiver(429, 200) as to:
        assert sent(to, tmp_path / "l.jsonl") == (["delivered 2"], [7.0])


def test_what_is_refused_is_not_repeated_in_a_run_and_sent_by_the_next(tmp_path: Path) -> None:
    with receiver(401, 302, 204) as to:
        ledger = tmp_path / "l.jsonl"
        assert sent(to, ledger)[0] == ["failed 1 answered 401"]
        assert sent(to, ledger)[0] == ["failed 1 answered 302"]
        assert sent(to, ledger)[0] == ["delivered 1"]


def test_nobody_there_is_said_after_all_attempts(tmp_path: Path) -> None:
    with receiver() as to:
        pass
    (said,), waits = sent(to, tmp_path / "l.jsonl", attempts=3)
    assert said == "failed 3 connection refused" and waits == [1.0, 2.0]


@pytest.mark.parametrize(
    ("answer", "why"), [("hang", "no answer within 0.3 s"), ("cut", "closed the connection")]
)
def test_why_it_was_not_delivered_is_in_words(tmp_path: Path, answer: str, why: str) -> None:
    with receiver(answer) as to:
        (said,), _ = sent(to, tmp_path / "l.jsonl", attempts=1)
    assert why in said and "Error" not in said


@pytest.mark.parametrize(
    "url", ["nonsense", "", "https://", "http://a:port/x", "http://[::1", "http://h/a b",
            f"https://{'a' * 70}/x", "https://u:secret@h:0/x?token=t"],
)  # fmt: skip
def test_what_is_no_address_is_a_sentence_without_what_is_secret(url: str) -> None:
    with pytest.raises(ValueError, match="is no address: give one like https://host/path") as error:
        Webhook(url=url)
    assert "://nonsense" not in str(error.value)
    assert "secret" not in str(error.value) and "token" not in str(error.value)


def test_two_runs_at_a_time_deliver_once(tmp_path: Path) -> None:
    with receiver() as to:
        runs = [threading.Thread(target=sent, args=(to, tmp_path / "l.jsonl")) for _ in range(4)]
        for one in runs:
            one.start()
        for one in runs:
            one.join()
        assert len(to.requests) == 1


def test_another_place_gets_it_too_and_an_address_is_checked(tmp_path: Path) -> None:
    with receiver() as one, receiver() as other:
        assert sent(one, tmp_path / "l.jsonl")[0] == sent(other, tmp_path / "l.jsonl")[0]
    with pytest.raises(ValueError, match="webhook ftp://host/x is no address"):
        Webhook(url="ftp://user:word@host/x")


def test_the_e_mail_says_what_where_when_who_and_that_it_is_simulated() -> None:
    text = email_text([INCIDENT], "mill01", 1.7e9)
    message = message_from_string(text, policy=policy.default)
    assert message["Subject"] == "mill01: 1 to act on, 0 to watch"
    body = message.get_content()
    for words in ("[act] Spindle load over its limit (simulated)", "spindle drive",
                  "131 %, limit 110", "program O2040", "process engineer",
                  INCIDENT.id):  # fmt: skip
        assert words in body
