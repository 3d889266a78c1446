import pytest


@pytest.fixture
def job_file(tmp_path):
    """Function that writes a job file, and returns its path."""
    def write(text):
        path = tmp_path / 'job.yaml'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write
