"""The client's side of an upload: its states, what can happen, and every transition."""

from enum import Enum

from mission_io.protocol.table import Row, Table, staying


class UploadState(Enum):
    """Where an upload is."""

    ANNOUNCED = "COUNT sent, no item asked for yet"
    SERVING = "items are being asked for"
    CONFIRMING = "every item was sent; the final acknowledgement is awaited"
    ACKED_EARLY = "an acknowledgement came before every item was sent; it may be about an earlier transfer"
    DOUBTING = "an ERROR came that may only answer a duplicate"
    RECHECKING = "an ERROR came after everything was sent; the list may be there already"
    BACKING_OFF = "the vehicle was busy; COUNT goes out again later"
    CANCELLING = "the vehicle is being told that the upload is off"
    ACCEPTED = "the vehicle took the list"
    UNCONFIRMED = "everything was sent, the final answer is missing or doubtful"
    REFUSED = "the vehicle refused"
    VEHICLE_CANCELLED = "the vehicle cancelled"
    CANCELLED = "this side cancelled"
    SILENT = "the vehicle fell silent"
    ACCEPTED_EARLY = "the vehicle accepted the list before it had asked for every item"
    STUCK = "the vehicle answers but does not get on"


class UploadEvent(Enum):
    """What can happen to an upload."""

    REQUEST = "an item is asked for"
    REQUEST_LAST = "an item is asked for, and with it the last one goes out"
    REQUEST_CROSSED = "an item is asked for again that is on its way already, or too often"
    REQUEST_UNKNOWN = "an item that does not exist is asked for"
    ACK_ACCEPTED = "acknowledged"
    ACK_EARLY = "acknowledged although no item was asked for, and not for the first time"
    ACK_EMPTIED = "acknowledged, and the list is empty"
    ACK_BUSY = "no space, or denied: busy or just booted"
    ACK_SEQUENCE = "an item came out of sequence: it was there already, or one before it is missing"
    ACK_ERROR = "the result without a reason"
    ACK_REFUSED = "a result that says what is wrong"
    ACK_GAVE_UP = "the vehicle gave up, as after a long silence: begin anew"
    ACK_CANCELLED = "the vehicle gave up, and beginning anew did not help"
    RESEND = "silence: say it again"
    RESEND_LAST = "silence: say it again, and with it the last item goes out"
    STALL = "long silence: begin anew"
    NO_PROGRESS = "for long no item was asked for that had not been asked for before"
    GIVE_UP = "silence for good"
    RETRY = "waited long enough for a busy vehicle"
    EXHAUSTED = "busy for too long"
    DOUBT_OVER = "no sign that the transfer goes on"
    DOUBT_CONFIRMED = "the same, and beginning anew did not help"
    LINGER_OVER = "told it often enough"
    CANCEL = "this side wants to stop"


_S, _E = UploadState, UploadEvent
_ALL_ACKS = (
    _E.ACK_ACCEPTED,
    _E.ACK_EMPTIED,
    _E.ACK_BUSY,
    _E.ACK_SEQUENCE,
    _E.ACK_ERROR,
    _E.ACK_REFUSED,
    _E.ACK_CANCELLED,
)
_LIVE = (_S.ANNOUNCED, _S.SERVING, _S.CONFIRMING, _S.ACKED_EARLY, _S.DOUBTING, _S.RECHECKING, _S.BACKING_OFF)
_WITHOUT_AN_END = (_S.ANNOUNCED, _S.SERVING, _S.CONFIRMING)

UPLOAD_TABLE: Table[UploadState, UploadEvent] = Table(
    [
        Row(_S.ANNOUNCED, _E.REQUEST, _S.SERVING, "send_items"),
        Row(_S.ANNOUNCED, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        Row(_S.ANNOUNCED, _E.ACK_EMPTIED, _S.ACCEPTED),
        Row(_S.ANNOUNCED, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        # PX4 has no other word for "busy with another ground station" than ERROR.
        Row(_S.ANNOUNCED, _E.ACK_ERROR, _S.BACKING_OFF, "note_busy"),
        Row(_S.ANNOUNCED, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.ANNOUNCED, _E.RESEND, _S.ANNOUNCED, "resend_count"),
        Row(_S.ANNOUNCED, _E.GIVE_UP, _S.SILENT),
        Row(_S.ANNOUNCED, _E.ACK_EARLY, _S.ACCEPTED_EARLY, "send_cancel"),
        # Leftovers of an earlier transfer: its acknowledgement, its requests, the vehicle giving it up.
        *staying([_S.ANNOUNCED], [_E.REQUEST_UNKNOWN, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE, _E.ACK_CANCELLED]),
        #
        Row(_S.SERVING, _E.REQUEST, _S.SERVING, "send_items"),
        Row(_S.SERVING, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        Row(_S.SERVING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        # PX4 answers a late duplicate of COUNT so, and goes on with the transfer.
        Row(_S.SERVING, _E.ACK_ERROR, _S.DOUBTING),
        Row(_S.SERVING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.SERVING, _E.ACK_GAVE_UP, _S.ANNOUNCED, "restart"),
        Row(_S.SERVING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.SERVING, _E.RESEND, _S.SERVING, "resend_items"),
        Row(_S.SERVING, _E.RESEND_LAST, _S.CONFIRMING, "resend_items"),
        Row(_S.SERVING, _E.STALL, _S.ANNOUNCED, "begin_anew"),
        # It may belong to an earlier transfer; then this one goes on.
        Row(_S.SERVING, _E.ACK_ACCEPTED, _S.ACKED_EARLY),
        *staying([_S.SERVING], [_E.REQUEST_CROSSED, _E.REQUEST_UNKNOWN, _E.ACK_SEQUENCE]),
        #
        Row(_S.ACKED_EARLY, _E.REQUEST, _S.SERVING, "send_items"),
        Row(_S.ACKED_EARLY, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        Row(_S.ACKED_EARLY, _E.ACK_ACCEPTED, _S.ACCEPTED_EARLY, "send_cancel"),
        Row(_S.ACKED_EARLY, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.ACKED_EARLY, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.ACKED_EARLY, _E.ACK_GAVE_UP, _S.ANNOUNCED, "restart"),
        Row(_S.ACKED_EARLY, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        # Sent although it may be the last: an acknowledgement is no proof here any more.
        Row(_S.ACKED_EARLY, _E.RESEND, _S.ACKED_EARLY, "resend_items"),
        Row(_S.ACKED_EARLY, _E.RESEND_LAST, _S.ACKED_EARLY, "resend_items"),
        Row(_S.ACKED_EARLY, _E.DOUBT_OVER, _S.ACCEPTED_EARLY, "send_cancel"),
        *staying([_S.ACKED_EARLY], [_E.REQUEST_CROSSED, _E.REQUEST_UNKNOWN, _E.ACK_SEQUENCE, _E.ACK_ERROR]),
        #
        Row(_S.CONFIRMING, _E.REQUEST, _S.CONFIRMING, "send_items"),
        Row(_S.CONFIRMING, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        Row(_S.CONFIRMING, _E.ACK_ACCEPTED, _S.ACCEPTED),
        Row(_S.CONFIRMING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        # Autopilots answer an item so when they have the whole list already and their acknowledgement was lost.
        Row(_S.CONFIRMING, _E.ACK_ERROR, _S.RECHECKING),
        Row(_S.CONFIRMING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.CONFIRMING, _E.ACK_GAVE_UP, _S.ANNOUNCED, "restart"),
        Row(_S.CONFIRMING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.CONFIRMING, _E.RESEND, _S.CONFIRMING, "resend_items"),
        Row(_S.CONFIRMING, _E.RESEND_LAST, _S.CONFIRMING, "resend_items"),
        Row(_S.CONFIRMING, _E.STALL, _S.UNCONFIRMED),
        *staying([_S.CONFIRMING], [_E.REQUEST_CROSSED, _E.REQUEST_UNKNOWN, _E.ACK_SEQUENCE]),
        #
        Row(_S.RECHECKING, _E.REQUEST, _S.CONFIRMING, "send_items"),
        Row(_S.RECHECKING, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        # PX4 answers the last item but one with ERROR and the last with ACCEPTED, once it has them.
        Row(_S.RECHECKING, _E.ACK_ACCEPTED, _S.ACCEPTED),
        Row(_S.RECHECKING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.RECHECKING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.RECHECKING, _E.ACK_GAVE_UP, _S.ANNOUNCED, "restart"),
        Row(_S.RECHECKING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.RECHECKING, _E.DOUBT_OVER, _S.UNCONFIRMED),
        *staying([_S.RECHECKING], [_E.REQUEST_CROSSED, _E.REQUEST_UNKNOWN, _E.ACK_SEQUENCE, _E.ACK_ERROR]),
        #
        Row(_S.DOUBTING, _E.REQUEST, _S.SERVING, "send_items"),
        Row(_S.DOUBTING, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        Row(_S.DOUBTING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.DOUBTING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.DOUBTING, _E.ACK_GAVE_UP, _S.ANNOUNCED, "restart"),
        Row(_S.DOUBTING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.DOUBTING, _E.RESEND, _S.DOUBTING, "resend_items"),
        Row(_S.DOUBTING, _E.RESEND_LAST, _S.RECHECKING, "resend_items"),
        # The vehicle may have given up, and the message that said so was lost.
        Row(_S.DOUBTING, _E.DOUBT_OVER, _S.ANNOUNCED, "restart"),
        Row(_S.DOUBTING, _E.DOUBT_CONFIRMED, _S.REFUSED),
        *staying(
            [_S.DOUBTING],
            [_E.REQUEST_CROSSED, _E.REQUEST_UNKNOWN, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE, _E.ACK_ERROR],
        ),
        #
        Row(_S.BACKING_OFF, _E.REQUEST, _S.SERVING, "send_items"),
        Row(_S.BACKING_OFF, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        Row(_S.BACKING_OFF, _E.ACK_EMPTIED, _S.ACCEPTED),
        Row(_S.BACKING_OFF, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.BACKING_OFF, _E.RETRY, _S.ANNOUNCED, "ask_anew"),
        Row(_S.BACKING_OFF, _E.EXHAUSTED, _S.REFUSED),
        *staying(
            [_S.BACKING_OFF],
            [
                _E.REQUEST_CROSSED,
                _E.REQUEST_UNKNOWN,
                _E.ACK_ACCEPTED,
                _E.ACK_BUSY,
                _E.ACK_SEQUENCE,
                _E.ACK_ERROR,
                _E.ACK_CANCELLED,
            ],
        ),
        #
        *(Row(state, _E.NO_PROGRESS, _S.STUCK, "send_cancel") for state in _WITHOUT_AN_END),
        *(Row(state, _E.CANCEL, _S.CANCELLING, "send_cancel") for state in _LIVE),
        *(
            Row(_S.CANCELLING, event, _S.CANCELLING, "send_cancel")
            for event in (_E.REQUEST, _E.REQUEST_LAST, _E.REQUEST_UNKNOWN)
        ),
        *(Row(_S.CANCELLING, event, _S.CANCELLED) for event in _ALL_ACKS),
        Row(_S.CANCELLING, _E.LINGER_OVER, _S.CANCELLED),
        *staying([_S.CANCELLING], [_E.CANCEL, _E.REQUEST_CROSSED]),
    ]
)
"""Every transition of an upload. A finished upload listens to nothing."""

UPLOAD_ENDS = frozenset(
    {
        _S.ACCEPTED,
        _S.UNCONFIRMED,
        _S.REFUSED,
        _S.VEHICLE_CANCELLED,
        _S.CANCELLED,
        _S.SILENT,
        _S.ACCEPTED_EARLY,
        _S.STUCK,
    }
)
