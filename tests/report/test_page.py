"""HTML from untrusted text."""

from retarget.report.page import element, joined, safe


def test_text_is_only_text() -> None:
    assert safe("<script>\"&'") == "&lt;script&gt;&quot;&amp;&#x27;" and safe(None) == "" and safe(0) == "0"
    assert element("p", safe("a<b"), title='"><b>') == '<p title="&quot;&gt;&lt;b&gt;">a&lt;b</p>'


def test_attributes_that_python_cannot_name() -> None:
    assert element("i", class_="x", data_row="1", hidden=None) == '<i class="x" data-row="1"></i>'


def test_several_in_a_row() -> None:
    assert joined(element("b", safe(one)) for one in "ab") == "<b>a</b><b>b</b>"
