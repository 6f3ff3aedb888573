from viewer.services.messages import Kind
from viewer.session import Session


def test_errors_stay_and_are_reported_once(session: Session) -> None:
    for number in (1, 2, 2, 3, 4, 5, 6):
        session.messages.notify(f"wrong {number}", Kind.ERROR)
        session.messages.notify(f"news {number}")
    assert session.messages.errors == [f"wrong {number}" for number in range(1, 7)]
    assert [one.text for one in session.messages.all if one.kind is Kind.INFO] == [f"news {n}" for n in (3, 4, 5, 6)]
