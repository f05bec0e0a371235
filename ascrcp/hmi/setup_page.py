"""The commissioning page: locked by a PIN; one part at a time."""

from ascrcp.hmi.contract import Session
from ascrcp.hmi.page import Page
from ascrcp.hmi.theme import Screen


class SetupPage(Page):
    """Parts for the commissioning engineer."""

    key = "setup"

    def __init__(self, session: Session, screen: Screen) -> None:
        super().__init__()
