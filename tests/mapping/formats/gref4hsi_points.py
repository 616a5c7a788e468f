"""Run by an interpreter that has gref4hsi: its own steps, from its settings to the points it writes into the file.

python gref4hsi_points.py SETTINGS.ini
"""

import sys

from gref4hsi.scripts import georeference
from gref4hsi.utils import parsing_utils

if __name__ == "__main__":
    parsing_utils.export_pose(sys.argv[1])
    georeference.main(sys.argv[1])
