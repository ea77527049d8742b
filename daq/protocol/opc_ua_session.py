"""A session with an OPC UA server and a subscription in it, as talks (see `daq.protocol.opc_ua_nodes`).

The session is anonymous and only reads. The server samples each axis at the interval asked for and keeps the values of
up to a second; each has its stamp, so that nothing depends on when the server sends them. A value is sent whenever its
stamp has changed, whether or not the axis moved.
"""

from __future__ import annotations

from typing import Any

from asyncua import ua

from daq.protocol.opc_ua import CHUNK, CHUNKS, LIMIT
from daq.protocol.opc_ua_nodes import RobotNodes, Talk, Unfit
from rigs.schema.feedback import OPCUARobotics

CHANNEL_MS = 3_600_000
"""How long a channel is asked to live before it is renewed."""
_SHORTEST_SESSION_S = 10.0
"""A session that was left is soon given up by the server, which has few."""
_NONCE = bytes(32)
"""Some servers want one of 32 bytes even where nothing is encrypted with it."""
_QUEUED_S = 1.0
_LIFETIME = 10
"""Times without any message after which the server gives the subscription up."""


class Refused(Exception):
    """The server refuses a request; the name of its status code."""


def hello(feedback: OPCUARobotics) -> Any:
    """Return what opens a connection."""
    sizes = {"ReceiveBufferSize": CHUNK, "SendBufferSize": CHUNK, "MaxMessageSize": LIMIT}
    return ua.Hello(**sizes, MaxChunkCount=CHUNKS, EndpointUrl=endpoint(feedback))


def endpoint(feedback: OPCUARobotics) -> str:
    """Return the address of the server as OPC UA writes it."""
    return f"opc.{feedback.port}{feedback.path}"


def channel_request(*, renew: bool) -> Any:
    """Return the request for a channel without security, or for the next token of the one that is open."""
    request = ua.OpenSecureChannelRequest()
    kind = ua.SecurityTokenRequestType
    request.Parameters.RequestType = kind.Renew if renew else kind.Issue
    request.Parameters.SecurityMode = ua.MessageSecurityMode.None_
    request.Parameters.RequestedLifetime = CHANNEL_MS
    return request


def session(feedback: OPCUARobotics) -> Talk[None]:
    """Open a session without a user. Raises Unfit where the server wants one."""
    request = ua.CreateSessionRequest()
    asked = request.Parameters
    asked.ClientDescription.ApplicationUri = "urn:rig"
    asked.ClientDescription.ApplicationName = ua.LocalizedText("rig")
    asked.ClientDescription.ApplicationType = ua.ApplicationType.Client
    asked.EndpointUrl, asked.SessionName, asked.ClientNonce = endpoint(feedback), "rig", _NONCE
    asked.RequestedSessionTimeout = 1e3 * max(_SHORTEST_SESSION_S, 2 * feedback.timeout_s)
    asked.MaxResponseMessageSize = LIMIT
    created = (yield request).Parameters
    unsecured = [end for end in created.ServerEndpoints or () if end.SecurityMode == ua.MessageSecurityMode.None_]
    tokens = [token for end in unsecured for token in end.UserIdentityTokens or ()]
    anonymous = [token for token in tokens if token.TokenType == ua.UserTokenType.Anonymous]
    if not anonymous:
        raise Unfit("the server wants a user or encryption for reading; allow anonymous reading in its settings")
    activation = ua.ActivateSessionRequest()
    activation.Parameters.UserIdentityToken = ua.AnonymousIdentityToken(PolicyId=anonymous[0].PolicyId)
    yield activation


def subscribed(nodes: RobotNodes, feedback: OPCUARobotics) -> Talk[None]:
    """Subscribe to all nodes, by their places as handles. Raises Refused where the server does not serve that."""
    interval_ms = 1e3 / feedback.rate_hz
    request = ua.CreateSubscriptionRequest()
    asked = request.Parameters
    asked.RequestedPublishingInterval, asked.PublishingEnabled = interval_ms, True
    asked.RequestedMaxKeepAliveCount = _keep_alive(interval_ms, feedback)
    asked.RequestedLifetimeCount = _LIFETIME * asked.RequestedMaxKeepAliveCount
    made = (yield request).Parameters
    if made.RevisedPublishingInterval * made.RevisedMaxKeepAliveCount > 500 * feedback.timeout_s:
        change = ua.ModifySubscriptionRequest()
        changed = change.Parameters
        changed.SubscriptionId = made.SubscriptionId
        changed.RequestedPublishingInterval = made.RevisedPublishingInterval
        changed.RequestedMaxKeepAliveCount = _keep_alive(made.RevisedPublishingInterval, feedback)
        changed.RequestedLifetimeCount = _LIFETIME * changed.RequestedMaxKeepAliveCount
        yield change
    items = ua.CreateMonitoredItemsRequest()
    items.Parameters.SubscriptionId = made.SubscriptionId
    items.Parameters.TimestampsToReturn = ua.TimestampsToReturn.Both  # the server's own, where there is no source's
    items.Parameters.ItemsToCreate = [_item(place, node, interval_ms) for place, node in enumerate(nodes.all)]
    results = (yield items).Results or ()
    refused = [result.StatusCode.name for result in results[: len(nodes.axes)] if not result.StatusCode.is_good()]
    if refused or len(results) < len(nodes.axes):
        raise Refused(refused[0] if refused else "too few answers")


def _keep_alive(interval_ms: float, feedback: OPCUARobotics) -> int:
    """After how many intervals without anything new the server says so: three times within the time-out."""
    return max(1, int(1e3 * feedback.timeout_s / 3 / max(interval_ms, 1.0)))


def _item(place: int, node: Any, interval_ms: float) -> Any:
    item = ua.MonitoredItemCreateRequest()
    item.ItemToMonitor = ua.ReadValueId(node, ua.AttributeIds.Value)
    item.MonitoringMode = ua.MonitoringMode.Reporting
    asked = item.RequestedParameters
    asked.ClientHandle, asked.SamplingInterval = place, interval_ms
    asked.QueueSize, asked.DiscardOldest = max(2, round(1e3 * _QUEUED_S / interval_ms)), True
    asked.Filter = ua.DataChangeFilter(Trigger=ua.DataChangeTrigger.StatusValueTimestamp)
    return item


def publish_request(acknowledged: Any | None = None) -> Any:
    """Return a request that the server answers with what is new. acknowledged: the answer before."""
    request = ua.PublishRequest()
    if acknowledged is not None:
        number = acknowledged.NotificationMessage.SequenceNumber
        request.Parameters.SubscriptionAcknowledgements = [
            ua.SubscriptionAcknowledgement(acknowledged.SubscriptionId, number)
        ]
    return request
