from viewer.services.signal import Signal


def test_all_receivers_are_called_in_order() -> None:
    signal, heard = Signal[str](), list[str]()
    signal.emit("before anybody listens")
    signal.connect(lambda text: heard.append(f"first {text}"))
    signal.connect(lambda text: heard.append(f"second {text}"))
    signal.emit("a")
    assert heard == ["first a", "second a"]
