"""The vehicle's side of the mission protocol: its states, what can happen, and every transition."""

from enum import Enum

from mission_io.protocol.table import Row, Table, staying


class ServerState(Enum):
    """What the vehicle's mission protocol is doing."""

    IDLE = "no transfer"
    RECEIVING = "an upload is going on"
    SENDING = "a download is going on that keeps uploads out"


class ServerEvent(Enum):
    """What can happen to the vehicle's mission protocol."""

    COUNT = "an upload is announced"
    COUNT_ZERO = "an empty list is announced"
    COUNT_REFUSED = "an upload is announced that cannot be taken: too long, too early, unknown list"
    COUNT_LATE = "the upload that is going on is announced again, and this autopilot does not start over"
    COUNT_OTHER = "another ground station, or another list, during an upload"
    ITEM = "the item that was asked for"
    ITEM_LAST = "the item that was asked for, and the last"
    ITEM_BAD = "the item that was asked for, and it cannot be taken"
    ITEM_STRAY = "an item that was not asked for"
    ITEM_AGAIN = "the last item of the upload that just ended, once more"
    ITEM_OTHER = "an item from another ground station, or for another list"
    LIST = "a list is asked for"
    LIST_HELD = "a list is asked for, and this autopilot takes no upload until it is acknowledged"
    REQUEST = "an item of a list is asked for"
    REQUEST_UNKNOWN = "an item that does not exist is asked for, or one that is not the next of the download"
    REQUEST_UNHEARD = "an item is asked for outside of a download, and this autopilot wants one to be begun"
    CLEAR = "a list is to be emptied"
    ACK = "the ground station has everything"
    ACK_CANCEL = "the ground station stops"
    REREQUEST = "silence during an upload: ask again"
    GIVE_UP = "silence during an upload for good"
    DOWNLOAD_OVER = "silence during a download for good"


_S, _E = ServerState, ServerEvent

SERVER_TABLE: Table[ServerState, ServerEvent] = Table(
    [
        Row(_S.IDLE, _E.COUNT, _S.RECEIVING, "begin"),
        Row(_S.IDLE, _E.COUNT_ZERO, _S.IDLE, "empty"),
        Row(_S.IDLE, _E.COUNT_REFUSED, _S.IDLE, "refuse"),
        Row(_S.IDLE, _E.ITEM_STRAY, _S.IDLE, "answer_idle_item"),
        Row(_S.IDLE, _E.ITEM_AGAIN, _S.IDLE, "accept_again"),
        Row(_S.IDLE, _E.LIST, _S.IDLE, "send_count"),
        Row(_S.IDLE, _E.LIST_HELD, _S.SENDING, "send_count"),
        Row(_S.IDLE, _E.REQUEST, _S.IDLE, "send_item"),
        Row(_S.IDLE, _E.REQUEST_UNKNOWN, _S.IDLE, "answer_error"),
        Row(_S.IDLE, _E.CLEAR, _S.IDLE, "clear"),
        *staying([_S.IDLE], [_E.REQUEST_UNHEARD, _E.ACK, _E.ACK_CANCEL]),
        #
        Row(_S.RECEIVING, _E.COUNT, _S.RECEIVING, "begin"),
        Row(_S.RECEIVING, _E.COUNT_ZERO, _S.IDLE, "empty"),
        Row(_S.RECEIVING, _E.COUNT_REFUSED, _S.RECEIVING, "refuse"),
        Row(_S.RECEIVING, _E.COUNT_LATE, _S.RECEIVING, "answer_error"),
        Row(_S.RECEIVING, _E.COUNT_OTHER, _S.RECEIVING, "answer_busy"),
        Row(_S.RECEIVING, _E.ITEM, _S.RECEIVING, "store"),
        Row(_S.RECEIVING, _E.ITEM_LAST, _S.IDLE, "store_last"),
        Row(_S.RECEIVING, _E.ITEM_BAD, _S.IDLE, "reject"),
        Row(_S.RECEIVING, _E.ITEM_STRAY, _S.RECEIVING, "answer_wrong_sequence"),
        Row(_S.RECEIVING, _E.ITEM_OTHER, _S.RECEIVING, "answer_other_item"),
        Row(_S.RECEIVING, _E.LIST, _S.RECEIVING, "answer_busy_request"),
        Row(_S.RECEIVING, _E.LIST_HELD, _S.RECEIVING, "answer_busy_request"),
        Row(_S.RECEIVING, _E.REQUEST, _S.RECEIVING, "answer_busy_request"),
        Row(_S.RECEIVING, _E.REQUEST_UNKNOWN, _S.RECEIVING, "answer_busy_request"),
        Row(_S.RECEIVING, _E.CLEAR, _S.RECEIVING, "answer_busy_clear"),
        Row(_S.RECEIVING, _E.ACK_CANCEL, _S.IDLE, "abandon"),
        Row(_S.RECEIVING, _E.REREQUEST, _S.RECEIVING, "ask"),
        Row(_S.RECEIVING, _E.GIVE_UP, _S.IDLE, "give_up"),
        *staying([_S.RECEIVING], [_E.ACK]),
        #
        Row(_S.SENDING, _E.COUNT, _S.SENDING, "answer_busy"),
        Row(_S.SENDING, _E.COUNT_ZERO, _S.SENDING, "answer_busy"),
        Row(_S.SENDING, _E.COUNT_REFUSED, _S.SENDING, "refuse"),
        Row(_S.SENDING, _E.ITEM_STRAY, _S.SENDING, "answer_idle_item"),
        Row(_S.SENDING, _E.ITEM_AGAIN, _S.SENDING, "answer_idle_item"),
        Row(_S.SENDING, _E.LIST_HELD, _S.SENDING, "send_count"),
        Row(_S.SENDING, _E.REQUEST, _S.SENDING, "send_item"),
        Row(_S.SENDING, _E.REQUEST_UNKNOWN, _S.IDLE, "answer_error"),
        Row(_S.SENDING, _E.CLEAR, _S.SENDING, "answer_busy_clear"),
        Row(_S.SENDING, _E.ACK, _S.IDLE),
        Row(_S.SENDING, _E.ACK_CANCEL, _S.IDLE),
        Row(_S.SENDING, _E.DOWNLOAD_OVER, _S.IDLE),
        *staying([_S.SENDING], [_E.REQUEST_UNHEARD]),
    ]
)
"""Every transition of the vehicle's side."""
