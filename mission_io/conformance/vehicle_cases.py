"""All cases that a vehicle is asked, in the order in which they are asked."""

from typing import Final

from mission_io.conformance.case import ProtocolCase
from mission_io.conformance.download_cases import DOWNLOAD_CASES
from mission_io.conformance.list_cases import LIST_CASES
from mission_io.conformance.probe import Probe
from mission_io.conformance.refusal_cases import REFUSAL_CASES
from mission_io.conformance.upload_cases import UPLOAD_CASES

VEHICLE_CASES: Final[tuple[ProtocolCase[Probe], ...]] = (*UPLOAD_CASES, *REFUSAL_CASES, *DOWNLOAD_CASES, *LIST_CASES)
