"""Delivery of incidents: each once to each webhook, signed, repeated until it is answered.

The signature is ``t=<seconds>,v1=<HMAC-SHA256 of "<seconds>.<body>" in hex>`` in the header
``Kerf-Signature``; the header ``Idempotency-Key`` is the incident's id, the same in each attempt,
so that a receiver whose answer was lost counts it once.
"""

import fcntl
import hmac
import http.client
import os
import re
import ssl
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from email.message import EmailMessage
from email.utils import format_datetime
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pipeline.schema.incident import Incident
from pipeline.schema.ranges import Range, Ranged
from pipeline.schema.store import json_line, read_lines

AGAIN = {408, 425, 429, *range(500, 600)}
"""Statuses after which the same is sent again; of the others, 409 says that it is there already."""
THERE = {*range(200, 300), 409}
MOST_ANSWER = 65536
"""Bytes of an answer that are read."""


@dataclass(frozen=True, kw_only=True)
class Webhook(Ranged, section="webhook"):
    """Where incidents are sent, and how often."""

    url: str
    secret: bytes = b""
    """Key of the signature; empty for none."""
    timeout_s: Annotated[float, Range(above=0.0, most=300.0, unit="s")] = 10.0
    attempts: Annotated[int, Range(least=1, most=20)] = 5
    wait_s: Annotated[float, Range(least=0.0, most=600.0, unit="s")] = 1.0
    """Wait before the second attempt; it doubles from one to the next."""

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            parts = urlsplit(self.url)
            host = (parts.hostname or "").encode("idna")
            right = parts.scheme in ("http", "https") and host != b"" and parts.port != 0
            right = right and self.url.isascii() and " " not in self.url
        except ValueError:  # a port that is no number, brackets that do not close, a long name
            right = False
        if not right:
            shown = re.sub("//.*@", "//", self.url.partition("?")[0]) or "(empty)"
            raise ValueError(f"webhook {shown} is no address: give one like https://host/path")

    @property
    def place(self) -> str:
        """Address without a query or password, which may be secret."""
        parts = urlsplit(self.url)
        port = f":{parts.port}" if parts.port else ""
        return f"{parts.scheme}://{parts.hostname or ''}{port}{parts.path}"


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """An incident as it was delivered, or why it was not."""

    incident: str
    to: str
    at: str
    """Time, ISO 8601."""
    attempts: int
    result: Literal["delivered", "failed"]
    why: str = ""


Clock = Callable[[], float]


def deliver(
    incidents: Sequence[Incident], webhook: Webhook, ledger: Path, *, now: Clock,
    wait: Callable[[float], object],
) -> list[Delivery]:  # fmt: skip
    """Send those incidents that the ledger does not hold as delivered to this place, oldest first.

    ``now`` gives seconds since 1970, ``wait`` waits.  Two runs at a time do not send the same: the
    second waits for the first.
    """
    found = []
    with _alone(ledger):
        done = {one.incident for one in deliveries(ledger)
                if one.to == webhook.place and one.result == "delivered"}  # fmt: skip
        for one in sorted(incidents, key=lambda one: one.start):
            if one.id in done:
                continue
            delivery = _sent(one, webhook, now, wait)
            _noted(delivery, ledger)
            found.append(delivery)
            done.add(one.id)
    return found


def deliveries(ledger: Path) -> list[Delivery]:
    """Entries of a ledger of deliveries; none where there is no file."""
    remedy = "correct the line, or delete the file, which sends every incident again"
    return [one for one, _ in read_lines(ledger, Delivery, remedy)]


def _sent(one: Incident, webhook: Webhook, now: Clock, wait: Callable[[float], object]) -> Delivery:
    body, why = json_line(one).encode(), ""
    for attempt in range(1, webhook.attempts + 1):
        pause = webhook.wait_s * 2 ** (attempt - 1)
        try:
            status, after = _post(body, one.id, webhook, now())
        except (OSError, http.client.HTTPException) as error:
            why = _reason(error, webhook)
        else:
            if status in THERE:
                return _delivery(one, webhook, now(), attempt, "delivered")
            why = f"answered {status}"
            if status not in AGAIN:
                return _delivery(one, webhook, now(), attempt, "failed", why)
            pause = max(pause, after)
        if attempt < webhook.attempts:
            wait(pause)
    return _delivery(one, webhook, now(), webhook.attempts, "failed", why)


def _reason(error: Exception, webhook: Webhook) -> str:
    """Why there was no answer, in words."""
    if isinstance(error, TimeoutError):
        return f"no answer within {webhook.timeout_s:g} s"
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not trusted ({error.verify_message})"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror[0].lower() + error.strerror[1:]
    closed = isinstance(error, http.client.RemoteDisconnected)
    return "it closed the connection without an answer" if closed else "its answer is not HTTP"


def _post(body: bytes, key: str, webhook: Webhook, at: float) -> tuple[int, float]:
    """Status of the answer, and the time to wait that it requests [s]."""
    parts = urlsplit(webhook.url)
    kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=webhook.timeout_s)
    headers = {"Content-Type": "application/json", "Idempotency-Key": key, "User-Agent": "kerf"}
    if webhook.secret:
        headers["Kerf-Signature"] = signature(body, webhook.secret, at)
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    try:
        connection.request("POST", path, body, headers)
        answer = connection.getresponse()
        answer.read(MOST_ANSWER)
        after = answer.getheader("Retry-After", "")
        return answer.status, min(float(after), 600.0) if after.isdigit() else 0.0
    finally:
        connection.close()


def signature(body: bytes, secret: bytes, at: float) -> str:
    """Signature of a body sent ``at`` [s since 1970].

    >>> signature(b"{}", b"key", 1.0)[:12]
    't=1,v1=1ba6b'
    """
    text = f"{at:.0f}.".encode() + body
    return f"t={at:.0f},v1={hmac.new(secret, text, 'sha256').hexdigest()}"


def _delivery(
    one: Incident, webhook: Webhook, at: float, attempts: int,
    result: Literal["delivered", "failed"], why: str = "",
) -> Delivery:  # fmt: skip
    text = datetime.fromtimestamp(at, UTC).isoformat(timespec="seconds")
    return Delivery(incident=one.id, to=webhook.place, at=text, attempts=attempts, result=result,
                    why=why)  # fmt: skip


@contextmanager
def _alone(ledger: Path) -> Iterator[None]:
    ledger.parent.mkdir(parents=True, exist_ok=True)
    with ledger.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _noted(delivery: Delivery, ledger: Path) -> None:
    with ledger.open("a", encoding="utf-8") as file:
        file.write(f"{json_line(delivery)}\n")
        file.flush()
        os.fsync(file.fileno())


def email_text(incidents: Sequence[Incident], machine: str, at: float) -> str:
    """Message (RFC 5322) on incidents, without addresses: what, where, since when, what to do."""
    acts, watched = (sum(one.severity == s for one in incidents) for s in ("act", "watch"))
    message = EmailMessage()
    message["Subject"] = f"{machine}: {acts} to act on, {watched} to watch"
    message["Date"] = format_datetime(datetime.fromtimestamp(at, UTC))
    message.set_content("\n\n".join(_paragraph(one) for one in incidents) or "No incident.",
                        cte="8bit")  # fmt: skip
    return message.as_string()


def _paragraph(one: Incident) -> str:
    often = f", {one.count} times" if one.count > 1 else ""
    simulated = " (simulated)" if one.origin == "simulated" else ""
    first = one.events[0]
    return (
        f"[{one.severity}] {one.title}{simulated}\n"
        f"{one.component}, {one.start} to {one.end}{often}\n"
        f"{first.rule.replace('_', ' ')} {first.value:g} {first.unit}, limit {first.limit:g}; "
        f"{first.evidence}\n"
        f"Who: {one.who}. Check: {one.check}\nId: {one.id}"
    )
