"""Where fuzzing starts: small files that hold every kind of record, and words of the formats."""

import gzip
import json

TIME = "2024-03-04T10:00:00.5Z"

_LOG = f"""\
* adapterVersion: 2.0
{TIME}|avail|AVAILABLE
{TIME}|Xact|-10.5|Yact|UNAVAILABLE|exec|ACTIVE
2024-03-04T10:00:01.123456789+02:00|Srpm|1.2e3
{TIME}@12.5|load|33
12345|counter|7
|counter|8
{TIME}|servo|fault|E17|500|HIGH|over "travel"
{TIME}|servo|normal||||
{TIME}|msg|M3|coolant is low\\|refill
{TIME}|vars|a=1 b="two words" c={{x=1 y=2}} d
{TIME}|offsets|G54={{X=1.5 Y=2}} G55={{X=0}}
{TIME}|wave|5|10|1 2 3.5 -4 5e-1
{TIME}|pos|1.0 2.0 3.0
{TIME}|@ASSET@|T1|CuttingTool|<CuttingTool toolId="T1"/>
{TIME}|@ASSET@|T2|CuttingTool|--multiline--AB
<CuttingTool>
</CuttingTool>
--multiline--AB
{TIME}|@REMOVE_ASSET@|T1
{TIME}|@UPDATE_ASSET@|T2|ToolLife|12
{TIME}|@REMOVE_ALL_ASSETS@|CuttingTool
"""

LOGS = (
    _LOG.encode(),
    _LOG.replace("\n", "\r\n").encode(),
    _LOG.encode("utf-16"),
    _LOG.replace("coolant", "Kühlmittel").encode("latin-1"),
    gzip.compress(_LOG.encode(), mtime=0),
    f"\ufeff{TIME}|a|1\n\0\0\0{TIME}|b|2".encode(),
    b"".join(f"{TIME}|Xact|{i}|exec|ACTIVE\n".encode() for i in range(20)),
)


def _stream(body: str, header: str = "", root: str = "MTConnectStreams") -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<{root} xmlns="urn:mtconnect.org:x:1.7">'
        f'<Header creationTime="{TIME}" instanceId="17" {header}/>{body}</{root}>\n'
    )


def _said(tag: str, text: str, item: str, more: str = "", sequence: int = 7) -> str:
    return (
        f'<{tag} dataItemId="{item}" timestamp="{TIME}" name="{item}" sequence="{sequence}"'
        f" {more}>{text}</{tag}>"
    )


_BODY = f"""<Streams><DeviceStream name="mill" uuid="u"><ComponentStream component="Linear" name="X"
 componentId="x"><Samples>
{_said("Position", "1.5", "x1")}
{_said("Position", "UNAVAILABLE", "x2")}
{_said("PathPosition", "1 2 3", "p1")}
{_said("AccelerationTimeSeries", "1 2 3", "w1", 'sampleCount="3" sampleRate="100"')}
</Samples><Events>
{_said("Execution", "ACTIVE", "e1")}
{_said("Message", "a &amp; b &#65; <![CDATA[<c>]]>", "m1", 'nativeCode="3"')}
{_said("VariableDataSet", '<Entry key="a">1</Entry><Entry key="b" removed="true"/>', "d1")}
{_said("OffsetTable", '<Entry key="G54"><Cell key="X">1</Cell></Entry>', "t1", 'count="1"')}
{_said("AssetChanged", "T1", "a1", 'assetType="CuttingTool"')}
</Events><Condition>
{_said("Fault", "over travel", "c1", 'type="ACTUATOR" nativeCode="E17" qualifier="HIGH"')}
<Normal dataItemId="c2" timestamp="{TIME}" sequence="9" type="SYSTEM"/>
</Condition></ComponentStream></DeviceStream></Streams>"""
_ASSETS = f"""<Assets><CuttingTool assetId="T1" timestamp="{TIME}" deviceUuid="u"><!-- one -->
<CuttingToolLifeCycle><ToolLife type="MINUTES">3</ToolLife></CuttingToolLifeCycle></CuttingTool>
</Assets>"""
_DEVICES = """<Devices><Device id="d" name="mill" uuid="u"><DataItems>
<DataItem id="x1" name="Xact" category="SAMPLE" type="POSITION" units="MILLIMETER"/></DataItems>
</Device></Devices>"""
_ERRORS = '<Errors><Error errorCode="OUT_OF_RANGE">no such sequence</Error></Errors>'

_STREAMS = _stream(_BODY)
_SAMPLES = "".join(_said("Position", f"{i}.25", "x1", sequence=i) for i in range(30))
_PART = f"--part\r\nContent-type: text/xml\r\nContent-length: {len(_STREAMS)}\r\n\r\n{_STREAMS}\r\n"

DOCUMENTS = (
    _STREAMS.encode(),
    (_STREAMS + _STREAMS).encode(),
    (_PART + _PART + "--part--\r\n").encode(),
    _STREAMS.replace("UTF-8", "UTF-16").encode("utf-16"),
    _STREAMS.replace("UTF-8", "ISO-8859-1").replace("over", "über").encode("latin-1"),
    _stream(_ASSETS, root="MTConnectAssets").encode(),
    _stream(_DEVICES, root="MTConnectDevices").encode(),
    _stream(_ERRORS, root="MTConnectError").encode(),
    _stream(
        '<Streams><DeviceStream name="mill" uuid="u"><ComponentStream component="Linear"><Samples>'
        f"{_SAMPLES}</Samples></ComponentStream></DeviceStream></Streams>"
    ).encode(),
    _DEVICES[9:-10].encode(),
)

_POSITION = {"dataItemId": "x1", "timestamp": TIME, "sequence": 7, "name": "Xact", "value": 1.5}
_COMPONENT = {
    "component": "Linear",
    "componentId": "x",
    "Samples": [
        {"Position": _POSITION},
        {"PathPosition": {**_POSITION, "value": [1, 2, 3]}},
        {"AccelerationTimeSeries": {**_POSITION, "sampleCount": 2, "value": [1.5, 2]}},
    ],
    "Events": {
        "Execution": [{**_POSITION, "value": "ACTIVE"}],
        "VariableDataSet": [{**_POSITION, "count": 1, "value": {"a": 1, "b": {"removed": True}}}],
        "OffsetTable": [{**_POSITION, "value": {"G54": {"X": 1.5}}}],
    },
    "Condition": [{"Fault": {**_POSITION, "type": "ACTUATOR", "nativeCode": "E17"}}],
}
_HEADER = {"Header": {"instanceId": 17, "creationTime": TIME}}
_JSON = [
    {
        "MTConnectStreams": {
            **_HEADER,
            "Streams": [
                {"DeviceStream": {"name": "mill", "uuid": "u", "ComponentStreams": [_COMPONENT]}}
            ],
        }
    },
    {
        "MTConnectStreams": {
            **_HEADER,
            "Streams": {
                "DeviceStream": [{"name": "mill", "uuid": "u", "ComponentStream": [_COMPONENT]}]
            },
        }
    },
    {
        "MTConnectAssets": {
            **_HEADER,
            "Assets": [{"CuttingTool": {"assetId": "T1", "timestamp": TIME, "deviceUuid": "u"}}],
        }
    },
    {
        "MTConnectError": {
            **_HEADER,
            "Errors": [{"Error": {"errorCode": "OUT_OF_RANGE", "value": "no"}}],
        }
    },
    {"dataItemId": "x1", "timestamp": TIME, "sequence": 7, "result": "1.5", "type": "POSITION"},
    {"dataItemId": "c1", "timestamp": TIME, "level": "FAULT", "nativeCode": "3"},
    {"dataItemId": "d1", "timestamp": TIME, "entries": [{"key": "a", "value": "1"}]},
    {"dataItemId": "t1", "timestamp": TIME, "entries": [{"key": "a", "cells": [{"key": "b"}]}]},
    {"dataItemId": "w1", "timestamp": TIME, "samples": [1, 2, 3], "sampleRate": 10},
    {"assetId": "T1", "type": "CuttingTool", "timestamp": TIME},
    {"id": "x1", "category": "SAMPLE", "type": "POSITION"},
]

TREES = (
    *(json.dumps(tree).encode() for tree in _JSON),
    b"\n".join(json.dumps(tree).encode() for tree in _JSON[4:]) + b"\n{broken\n",
    json.dumps(_JSON[4:]).encode(),
    json.dumps(_JSON[0]).encode("utf-16"),
)

WORDS = (
    "UNAVAILABLE", "|", "@", "\\|", '"', "--multiline--AB", "@ASSET@", "@REMOVE_ASSET@", TIME,
    "1678-01-01T00:00:00Z", "2261-12-31T23:59:60Z", "9999-99-99T99:99:99Z", "1e309", "-0", "nan",
    "18446744073709551615", "18446744073709551616", "={", "}", "a={b={c=1}}", "* shdrVersion: 2",
    "<!DOCTYPE a [<!ENTITY b 'c'>]>", "&b;", "&#0;", "&#x110000;", "<![CDATA[", "]]>", "<!--",
    "-->", "<?xml version='1.0' encoding='", "UTF-32", "UTF-7", "unicode_escape", "punycode",
    "undefined", "<MTConnectStreams>", "</Samples>", "<Samples>", "<Entry key='", "<Cell key=''>",
    " sequence='", " timestamp='", " dataItemId='", " sampleRate='", " removed='true'", "\0",
    "\ufeff", "\ud7ff", "{}", "[]", "[[[[", "null", '"value":', '"entries":', '"Streams":', ":{",
)  # fmt: skip
"""Put in by the generators that know nothing of the formats."""
