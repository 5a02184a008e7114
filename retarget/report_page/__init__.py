"""The report of a run as one HTML page that opens from disk: what was asked, what was measured, the motion."""

from retarget.report_page.page import page_html, write_page

__all__ = ["page_html", "write_page"]
