"""The subscription of a host: packages refused, in part, silent, asked for anew."""

from __future__ import annotations

import pytest
from scripted_aircraft import FAST, RTK, Flight

from tirgeo_ros.core.config.dji import DjiHostConfig
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.host.session import HostSession, HostState
from tirgeo_ros.dji.protocol.commands import (
    AddPackage,
    RemovePackage,
    ResetPackages,
)
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, Package, PackageTable


def ready(flight):
    return flight.fly(60.0, HostState.READY)


def test_packages_are_what_was_wanted_byte_by_byte():
    flight = ready(Flight(packages=[RTK, FAST]))
    assert flight.aircraft.packages[0] == AddPackage(0, 5, True, (0x1DF9A6B6, 0xF45D73FD))
    assert flight.aircraft.packages[3] == AddPackage(3, 400, True, (0xECBEF06D,))


def test_where_the_reset_fails_each_is_removed():
    flight = Flight(packages=[RTK])
    flight.aircraft.packages = {0: "old", 4: "old"}
    flight.aircraft.refusals = lambda r: 0x08 if isinstance(r, ResetPackages) else None
    ready(flight)
    removed = [r.id for r in flight.aircraft.asked if isinstance(r, RemovePackage)]
    assert removed == [0, 1, 2, 3, 4]
    assert list(flight.aircraft.packages) == flight.known == [0]


def test_a_package_that_exists_in_spite_of_the_reset_is_replaced():
    flight = Flight(packages=[RTK])
    flight.aircraft.packages = {0: "old"}
    flight.aircraft.refusals = lambda r: 0 if isinstance(r, ResetPackages) else None
    ready(flight)
    assert flight.aircraft.packages[0] == AddPackage(0, 5, True, (0x1DF9A6B6, 0xF45D73FD))


@pytest.mark.parametrize("code", [0x06, 0x07, 0x20, 0x22])
def test_a_package_refused_for_good_does_not_stop_the_others(code):
    flight = Flight()
    wrong = lambda r: isinstance(r, AddPackage) and r.id == 2  # noqa: E731
    flight.aircraft.refusals = lambda r: code if wrong(r) else None
    flight.fly(100.0)
    assert flight.known == sorted(flight.aircraft.packages) == [0, 1, 3, 4]
    assert flight.session.state is HostState.INCOMPLETE
    assert "package 2 refused: " in flight.session.message
    assert sum(map(wrong, flight.aircraft.asked)) == 1


def test_a_package_refused_for_now_is_tried_again():
    flight = Flight()
    wrong = lambda r: isinstance(r, AddPackage) and r.id == 2  # noqa: E731
    flight.aircraft.refusals = lambda r: 0x08 if wrong(r) else None
    flight.fly(100.0)
    assert flight.known == [0, 1, 3, 4]
    flight.aircraft.refusals = lambda _: None
    flight.fly(31.0, HostState.READY)
    assert flight.known == [0, 1, 2, 3, 4]
    assert flight.kinds.count("ResetPackages") == 1  # the others were left alone


def rtk_is_off(request):
    rtk = {topic.uid for topic in USUAL_PACKAGES[0].topics if topic.name.startswith("RTK_")}
    is_rtk = isinstance(request, AddPackage) and rtk & set(request.uids)
    return 0x25 if is_rtk else None


def test_rtk_that_is_switched_on_later_is_found():
    flight = Flight()
    flight.aircraft.refusals = rtk_is_off
    flight.fly(100.0)
    flight.aircraft.refusals = lambda _: None
    flight.fly(31.0, HostState.READY)
    assert flight.table == PackageTable()
    uids = {number: package.uids for number, package in flight.aircraft.packages.items()}
    assert uids[0] == tuple(topic.uid for topic in USUAL_PACKAGES[0].topics)


def test_a_package_with_topics_unknown_and_offline_is_tried_again_for_the_latter():
    mixed = Package.of(2, 5, with_timestamp=True, names=("GPS_DATE", "RTK_YAW", "HEIGHT_FUSION"))
    unknown = mixed.topics[2].uid
    flight = Flight(packages=[mixed])
    flight.aircraft.refusals = lambda r: (
        rtk_is_off(r) or (0x22 if isinstance(r, AddPackage) and unknown in r.uids else None)
    )
    flight.fly(50.0)
    assert [topic.name for topic in flight.table.get(2).topics] == ["GPS_DATE"]
    assert "without RTK_YAW, HEIGHT_FUSION: the source of a topic is off" in flight.session.message
    flight.aircraft.refusals = lambda r: (
        0x22 if isinstance(r, AddPackage) and unknown in r.uids else None
    )
    flight.fly(31.0)
    assert [topic.name for topic in flight.table.get(2).topics] == ["GPS_DATE", "RTK_YAW"]


def test_one_package_that_stops_is_asked_for_anew_alone():
    flight = ready(Flight())
    del flight.aircraft.packages[2]
    flight.fly(5.0)
    assert sorted(flight.aircraft.packages) == flight.known == [0, 1, 2, 3, 4]
    assert flight.session.state is HostState.READY
    assert flight.kinds.count("ResetPackages") == 1
    assert flight.kinds[-2:] == ["RemovePackage", "AddPackage"]


def test_a_package_that_never_comes_is_not_asked_for_all_the_time():
    flight = Flight()
    pushes = flight.aircraft.pushes
    flight.aircraft.pushes = lambda: [part for part in pushes() if part[14] != 3]
    flight.fly(200.0)
    asked = [r for r in flight.aircraft.asked if isinstance(r, AddPackage) and r.id == 3]
    assert 3 < len(asked) < 10  # after 3, 6, 12, 24, 48, 60 s


def test_a_package_that_cannot_be_asked_for_is_an_error_at_the_start():
    table = PackageTable([RTK._replace(rate_hz=70000)])
    with pytest.raises(DjiError, match=r"AddPackage.*cannot be sent"):
        HostSession(DjiHostConfig(subscribe=True), table)
