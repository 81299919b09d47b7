"""Settings of the report."""

from dataclasses import dataclass

from pipeline.report.texts import languages


@dataclass(frozen=True, kw_only=True)
class ReportSettings:
    """Settings of the pages of the fleet and of its machines."""

    language: str = "en"
    """Language of the fleet's and the leads' pages, by the name of its file in
    pipeline/report/languages; pages of evidence are in English."""

    def __post_init__(self) -> None:
        if self.language not in languages():
            raise ValueError(
                f"pages.language is {self.language!r}: choose one of {', '.join(languages())}"
            )
